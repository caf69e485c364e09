// Python binding of the event pixel: PixelArray, and the functions that tests compare with NumPy.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "bindings/bound_pixels.h"

namespace evs {
namespace {

using Line = Array<const float, 1>;
using Floats = nb::ndarray<nb::numpy, float, nb::ndim<1>>;

LogMap make_log_map(const std::string& log, float exposure_dn, float dark_dn, float linlog_dn,
                    float log_eps) {
  if (log == "linlog") return LogMap::linlog(exposure_dn, dark_dn, linlog_dn);
  if (log == "log_eps") return LogMap::log_eps(exposure_dn, dark_dn, log_eps);
  if (log == "ln" && !(dark_dn > 0.0f)) {
    throw std::invalid_argument("log = ln needs a dark current above 0");
  }
  if (log == "ln") return LogMap::physical(exposure_dn, dark_dn);
  throw std::invalid_argument("log must be linlog, log_eps or ln, not " + log);
}

// The settings that all pixels share.
PixelSettings settings_from(const Fields& field) {
  PixelSettings settings;
  std::string log;
  float exposure_dn = 0.0f, dark_dn = 0.0f, linlog_dn = 0.0f, log_eps = 0.0f;
  uint64_t seed = 0;
  field("log", log);
  field("exposure_dn", exposure_dn);
  field("dark_dn", dark_dn);
  field("linlog_dn", linlog_dn);
  field("log_eps", log_eps);
  field("seed", seed);
  settings.each(field);
  settings.map = make_log_map(log, exposure_dn, dark_dn, linlog_dn, log_eps);
  settings.running_mean = settings.least_gain > 0.0f;
  settings.shot.key = hash(seed, TERM_SHOT + 1);
  settings.photon.key = hash(seed, TERM_PHOTON_NOISE + 1);
  return settings;
}

Floats natural_log(Line values) {
  std::unique_ptr<float[]> out(new float[values.shape(0)]);
  for (size_t i = 0; i < values.shape(0); i++) out[i] = ln(values.data()[i]);
  return owned<Floats>(std::move(out), values.shape(0));
}

nb::tuple lowpass_steps(Line z) {
  std::unique_ptr<float[]> a(new float[z.shape(0)]), b(new float[z.shape(0)]);
  for (size_t i = 0; i < z.shape(0); i++) {
    const LowpassStep step = lowpass_step(z.data()[i]);
    a[i] = step.a;
    b[i] = step.b;
  }
  return nb::make_tuple(owned<Floats>(std::move(a), z.shape(0)),
                        owned<Floats>(std::move(b), z.shape(0)));
}

Floats large_signal_steps(Line z, Line y0, Line x0, Line x1) {
  std::unique_ptr<float[]> out(new float[z.shape(0)]);
  for (size_t i = 0; i < z.shape(0); i++) {
    out[i] = large_signal(z.data()[i], y0.data()[i], x0.data()[i], x1.data()[i]);
  }
  return owned<Floats>(std::move(out), z.shape(0));
}

Floats log_map(Line luminance, const std::string& log, float exposure_dn, float dark_dn,
               float linlog_dn, float log_eps) {
  const LogMap map = make_log_map(log, exposure_dn, dark_dn, linlog_dn, log_eps);
  const size_t count = luminance.shape(0);
  std::unique_ptr<float[]> out(new float[count]);
  for (size_t i = 0; i < count; i++) {
    const float dn = to_dn(map, luminance.data()[i]);
    const bool usable = is_usable(luminance.data()[i], dn);
    out[i] = usable ? to_log(map, dn) : std::bit_cast<float>(0x7fc00000u);
  }
  return owned<Floats>(std::move(out), count);
}

}  // namespace

BoundPixels::BoundPixels(nb::object settings, nb::object pattern, int width, int height,
                         int threads, const std::string& isa)
    : width_(static_cast<size_t>(width)), height_(static_cast<size_t>(height)), keep_(pattern) {
  const PixelSettings of_all = settings_from(Fields(settings));
  PixelPattern of_each;
  of_each.each([&]<class T>(const char* name, const T*& array) {
    const nb::object value = pattern.attr(name);
    if (!value.is_none()) array = memory<const T, 2>(value, {height_, width_});
  });
  require(of_each.theta_on != nullptr && of_each.theta_off != nullptr,
          "every pixel has thresholds");
  require(of_each.parasitic == nullptr || of_each.leak != nullptr,
          "a parasitic leak needs the array of leaks");
  require(of_each.refractory == nullptr || of_all.refractory > 0,
          "refractory periods of pixels need one in the settings");
  require((of_each.shot_on == nullptr) == (of_each.shot_off == nullptr),
          "shot noise has rates of both polarities");
  require(of_all.photon.scale <= 0.0 || of_all.lowpass() || of_all.follower > 0.0,
          "photon noise needs a pole");
  array_ = std::make_unique<PixelArray>(of_all, of_each, width, height, threads, isa);
}

EventBuffer BoundPixels::step(PixelArrays arrays, const Tick& tick, int64_t t_begin_us,
                              int64_t ticks, size_t& clamped) {
  return array_->step(with_gains(arrays, ticks), tick, t_begin_us, clamped);
}

nb::tuple BoundPixels::step_tick(FrameIn<float> luminance, int64_t t_begin_us, int64_t clock_us,
                                 int64_t tick_us, int64_t ticks, const nb::dict& state,
                                 std::optional<Array<const int32_t, 2>> row_reads, bool all_due) {
  const PixelArrays arrays = bind(state);
  require(luminance.shape(0) == height_ && luminance.shape(1) == width_,
          "every array of pixels must be (height, width)");
  check_tick_us(tick_us);
  Tick tick{luminance.data(), clock_us, static_cast<uint32_t>(tick_us)};
  if (row_reads) tick.rows = checked_reads(*row_reads, tick_us);
  tick.all_due = all_due;
  EventBuffer buffer;
  size_t clamped = 0;
  {
    GilRelease release;
    buffer = step(arrays, tick, t_begin_us, ticks, clamped);
  }
  return nb::make_tuple(owned<Bytes>(std::move(buffer.events), buffer.count), clamped);
}

std::vector<std::string> BoundPixels::state() const {
  std::vector<std::string> names;
  PixelArrays none;
  each_array(none, array_->settings(), array_->pattern(),
             [&](const char* name, auto*&, size_t, double, bool on) {
               if (on) names.emplace_back(name);
             });
  return names;
}

// The table of the state, for Python.
using StateRow = std::tuple<std::string, std::string, int, double, bool>;

std::vector<StateRow> pixel_state() {
  std::vector<StateRow> rows;
  PixelArrays none;
  each_array(none, {}, {},
             [&]<class T>(const char* name, T*&, size_t pixels, double first, bool always) {
               const char* kind = std::is_same_v<T, float>    ? "float32"
                                  : std::is_same_v<T, double> ? "float64"
                                                              : "int64";
               rows.emplace_back(name, kind, static_cast<int>(pixels), first, always);
             });
  return rows;
}

void bind_sensor(nb::module_& m) {
  nb::class_<BoundPixels>(
      m, "PixelArray",
      "Event pixels with a fixed pattern (emulator/sensor/pixel.py). The caller\n"
      "owns the state.")
      .def(nb::init<nb::object, nb::object, int, int, int, const std::string&>(),
           nb::arg("settings"), nb::arg("pattern"), nb::arg("width"), nb::arg("height"),
           nb::arg("threads") = 0, nb::arg("isa") = "auto",
           "Args:\n"
           "    settings: What all pixels share, as PlainModel of emulator/sensor/pixel.py makes\n"
           "        it. Terms at zero are off.\n"
           "    pattern: FixedPattern of emulator/sensor/fixed_pattern.py.\n"
           "    threads: The number of threads; 0 for one per core.\n"
           "    isa: An instruction set of isa_available(), or auto.")
      .def("step", &BoundPixels::step_tick, nb::arg("luminance").noconvert(), nb::arg("t_begin_us"),
           nb::arg("clock_us"), nb::arg("tick_us"), nb::arg("ticks"), nb::arg("state"),
           nb::arg("row_reads").noconvert().none() = nb::none(), nb::arg("all_due") = false,
           "Step all pixels by one tick.\n"
           "\n"
           "Args:\n"
           "    luminance: (h, w) float32.\n"
           "    t_begin_us: The stamp of the tick's start.\n"
           "    clock_us: The sensor's clock at the start: the sum of all ticks so far.\n"
           "    tick_us: The length of the tick.\n"
           "    ticks: The number of ticks so far.\n"
           "    state: The arrays of pixel_state() by name, modified in place.\n"
           "    row_reads: (n, 2) int32, rows of a frame that are read and when, us after the\n"
           "        start of the tick, by time; None for none.\n"
           "    all_due: Whether to skip no block, as after a change of the settings.\n"
           "\n"
           "Returns:\n"
           "    The event bytes, (16 n,) uint8, and the number of pixels with unusable\n"
           "    luminance.")
      .def("settle", &BoundPixels::settle, nb::arg("clock_us"), nb::arg("state"),
           "Account for the leak and the noise of the ticks in which blocks were skipped, so\n"
           "that other settings may take the state over.\n"
           "\n"
           "Args:\n"
           "    clock_us: The sensor's clock.\n"
           "    state: As in `step`.")
      .def_prop_ro("state", &BoundPixels::state, "The names of the arrays of their state.");
  m.def("pixel_state", &pixel_state,
        "Return the table of the state: for each array its name, its dtype, the pixels that a\n"
        "number is of, its first value and whether it is there whatever terms are on.");
  m.def("natural_log", &natural_log, nb::arg("values").noconvert(),
        "Return ln of normal positive float32 (n,), as the pixel computes it.");
  m.def("lowpass_steps", &lowpass_steps, nb::arg("z").noconvert(),
        "Return (a, b) of a one-pole low pass for z = 2 pi f dt (n,) float32, as the\n"
        "pixel does.");
  m.def("large_signal_steps", &large_signal_steps, nb::arg("z").noconvert(),
        nb::arg("y0").noconvert(), nb::arg("x0").noconvert(), nb::arg("x1").noconvert(),
        "Return y1 of the large-signal photoreceptor, (n,) float32 each, as the pixel\n"
        "steps it: z = 2 pi f dt, y0 its output, x0 and x1 the log light at the ends of\n"
        "the tick.");
  m.def("log_map", &log_map, nb::arg("luminance").noconvert(), nb::arg("log"),
        nb::arg("exposure_dn"), nb::arg("dark_dn"), nb::arg("linlog_dn"), nb::arg("log_eps"),
        "Return the log intensity of luminance (n,); NaN where it is negative, NaN or\n"
        "Inf.");
}

}  // namespace evs
