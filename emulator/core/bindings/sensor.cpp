// Python binding of the event pixel: PixelArray, and the functions that tests compare with NumPy.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include "bindings/bound_pixels.h"
#include "sensor/pixel_array.h"

namespace nb = nanobind;

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

// The settings that all pixels share, from keywords.
PixelSettings make_settings(const std::string& log, float exposure_dn, float dark_dn,
                            float linlog_dn, float log_eps, bool euler, bool large_signal,
                            double lowpass_low, double lowpass_slope, double follower,
                            double highpass, double parasitic_slope, uint32_t refractory_us,
                            bool causes, float noise_gain, float drift_gain, float least_gain,
                            float noise_weight, double shot_bright, bool shot_inverse,
                            double shot_slope, double shot_offset, double shot_dim_dn,
                            double aps_crosstalk, double photon_scale, uint64_t seed) {
  PixelSettings settings;
  settings.aps_crosstalk = aps_crosstalk;
  settings.map = make_log_map(log, exposure_dn, dark_dn, linlog_dn, log_eps);
  settings.euler = euler;
  settings.large_signal = large_signal;
  settings.lowpass_low = lowpass_low;
  settings.lowpass_slope = lowpass_slope;
  settings.follower = follower;
  settings.highpass = highpass;
  settings.parasitic_slope = parasitic_slope;
  settings.refractory = refractory_us;
  settings.causes = causes;
  settings.noise_gain = noise_gain;
  settings.drift_gain = drift_gain;
  settings.least_gain = least_gain;
  settings.noise_weight = noise_weight;
  settings.running_mean = least_gain > 0.0f;
  settings.shot.key = hash(seed, kTermShot + 1);
  settings.shot.bright = shot_bright;
  settings.shot.inverse = shot_inverse;
  settings.shot.slope = shot_slope;
  settings.shot.offset = shot_offset;
  settings.shot.dim_dn = shot_dim_dn;
  settings.photon.key = hash(seed, kTermPhotonNoise + 1);
  settings.photon.scale = photon_scale;
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

BoundPixels::BoundPixels(const PixelSettings& settings, int width, int height,
                         FrameIn<float> theta_on, FrameIn<float> theta_off, MaybeIn<float> leak,
                         MaybeIn<float> parasitic, MaybeIn<float> phase, MaybeIn<uint8_t> hot,
                         MaybeIn<float> shot_on, MaybeIn<float> shot_off,
                         MaybeIn<uint32_t> refractory, int threads, const std::string& isa)
    : settings_(settings),
      width_(static_cast<size_t>(width)),
      height_(static_cast<size_t>(height)),
      keep_(nb::make_tuple(theta_on, theta_off, leak, parasitic, phase, hot, shot_on, shot_off,
                           refractory)) {
  PixelPattern pattern;
  pattern.theta_on = pixels(theta_on);
  pattern.theta_off = pixels(theta_off);
  pattern.leak = pixels(leak);
  pattern.parasitic = pixels(parasitic);
  pattern.phase = pixels(phase);
  pattern.hot = pixels(hot);
  pattern.refractory = pixels(refractory);
  settings_.shot.on = pixels(shot_on);
  settings_.shot.off = pixels(shot_off);
  if (pattern.parasitic != nullptr && pattern.leak == nullptr) {
    throw std::invalid_argument("a parasitic leak needs the array of leaks");
  }
  if (pattern.refractory != nullptr && settings_.refractory == 0) {
    throw std::invalid_argument("refractory periods of pixels need one in the settings");
  }
  if ((settings_.shot.on == nullptr) != (settings_.shot.off == nullptr)) {
    throw std::invalid_argument("shot noise has rates of both polarities");
  }
  if (settings_.photon.scale > 0.0 && !settings_.lowpass() && settings_.follower == 0.0) {
    throw std::invalid_argument("photon noise needs a pole");
  }
  has_leak_ = pattern.leak != nullptr;
  array_ = std::make_unique<PixelArray>(settings_, pattern, width, height, threads, isa);
}

BoundPixels::~BoundPixels() = default;

EventBuffer BoundPixels::step(PixelArrays arrays, const Tick& tick, int64_t t_begin_us,
                              int64_t ticks, size_t& clamped) {
  return array_->step(with_gains(arrays, ticks), tick, t_begin_us, clamped);
}

nb::tuple BoundPixels::step_tick(FrameIn<float> luminance, int64_t t_begin_us, int64_t clock_us,
                                 int64_t tick_us, int64_t ticks, Array<double, 2> reference,
                                 Array<float, 2> last_log, Array<float, 2> last_luminance,
                                 MaybeFrame<float> filtered, MaybeFrame<float> followed,
                                 MaybeFrame<int64_t> blind_until, MaybeFrame<double> noise_budget,
                                 MaybeFrame<float> noise_mean, MaybeFrame<float> noise_memory,
                                 MaybeFrame<float> mean, MaybeFrame<float> noise,
                                 MaybeFrame<float> drift, MaybeBlocks due_us, MaybeBlocks since_us,
                                 MaybeBlocks shot_next, MaybeBlocks shot_count,
                                 std::optional<Array<const int32_t, 2>> row_reads, bool all_due) {
  const PixelArrays arrays =
      bind({reference, last_log, last_luminance, filtered, followed, blind_until, noise_budget,
            noise_mean, noise_memory, mean, noise, drift, due_us, since_us, shot_next, shot_count});
  check_tick_us(tick_us);
  Tick tick{pixels(luminance), clock_us, static_cast<uint32_t>(tick_us)};
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

void BoundPixels::settle(int64_t clock_us, Array<double, 2> reference,
                         Array<float, 2> last_luminance, MaybeBlocks due_us, MaybeBlocks since_us,
                         MaybeFrame<float> filtered, MaybeFrame<float> followed,
                         MaybeFrame<double> noise_budget, MaybeFrame<float> mean) {
  PixelArrays arrays;
  arrays.reference = pixels(reference);
  arrays.last_luminance = pixels(last_luminance);
  arrays.filtered = needed(settings_.lowpass(), pixels(filtered));
  arrays.followed = needed(settings_.follower > 0.0, pixels(followed));
  arrays.noise_budget = needed(settings_.photon.scale > 0.0, pixels(noise_budget));
  arrays.running_mean.mean = needed(settings_.running_mean, pixels(mean));
  arrays.due_us = needed(skips(), blocks(due_us));
  arrays.since_us = needed(skips(), blocks(since_us));
  array_->settle(arrays, clock_us);
}

void bind_sensor(nb::module_& m) {
  nb::class_<PixelSettings>(m, "PixelSettings", "The settings that all pixels share.")
      .def(nb::new_(&make_settings), nb::kw_only(), nb::arg("log"), nb::arg("exposure_dn"),
           nb::arg("dark_dn"), nb::arg("linlog_dn"), nb::arg("log_eps"), nb::arg("euler") = false,
           nb::arg("large_signal") = false, nb::arg("lowpass_low") = 0.0,
           nb::arg("lowpass_slope") = 0.0, nb::arg("follower") = 0.0, nb::arg("highpass") = 0.0,
           nb::arg("parasitic_slope") = 0.0, nb::arg("refractory_us") = 0,
           nb::arg("causes") = false, nb::arg("noise_gain") = 0.0f, nb::arg("drift_gain") = 0.0f,
           nb::arg("least_gain") = 0.0f, nb::arg("noise_weight") = 0.0f,
           nb::arg("shot_bright") = 1.0, nb::arg("shot_inverse") = false,
           nb::arg("shot_slope") = 0.0, nb::arg("shot_offset") = 0.0, nb::arg("shot_dim_dn") = 0.0,
           nb::arg("aps_crosstalk") = 0.0, nb::arg("photon_scale") = 0.0, nb::arg("seed") = 0,
           "Terms at zero are off.\n"
           "\n"
           "Args:\n"
           "    log: linlog, log_eps or ln.\n"
           "    exposure_dn, dark_dn, linlog_dn, log_eps: The map from luminance to log\n"
           "        intensity.\n"
           "    euler: Whether filters step as in v2e.\n"
           "    large_signal: Whether the photoreceptor is the large-signal one.\n"
           "    lowpass_low, lowpass_slope: The photoreceptor's 2 pi f at DN 0, 1 / us, and\n"
           "        its slope per DN.\n"
           "    follower, highpass: 2 pi f, 1 / us.\n"
           "    causes: Whether events hold their cause.\n"
           "    aps_crosstalk: By how much the read of a row lifts the signal, log units.\n"
           "    photon_scale: Of photon noise, variance times DN over bandwidth, us.");
  nb::class_<BoundPixels>(
      m, "PixelArray",
      "Event pixels with a fixed pattern (emulator/sensor/pixel.py). The caller\n"
      "owns the state.")
      .def(nb::init<const PixelSettings&, int, int, FrameIn<float>, FrameIn<float>, MaybeIn<float>,
                    MaybeIn<float>, MaybeIn<float>, MaybeIn<uint8_t>, MaybeIn<float>,
                    MaybeIn<float>, MaybeIn<uint32_t>, int, const std::string&>(),
           nb::arg("settings"), nb::arg("width"), nb::arg("height"), nb::kw_only(),
           nb::arg("theta_on"), nb::arg("theta_off"), nb::arg("leak").none() = nb::none(),
           nb::arg("parasitic").none() = nb::none(), nb::arg("phase").none() = nb::none(),
           nb::arg("hot").none() = nb::none(), nb::arg("shot_on").none() = nb::none(),
           nb::arg("shot_off").none() = nb::none(), nb::arg("refractory_us").none() = nb::none(),
           nb::arg("threads") = 0, nb::arg("isa") = "auto",
           "Args:\n"
           "    theta_on, theta_off: (h, w) float32, the thresholds, at least 2^-20.\n"
           "    leak, parasitic: (h, w) float32, log units per us; None for none.\n"
           "    phase: (h, w) float32, from the first reference up to the first light, log units.\n"
           "    hot: (h, w) uint8, 1 for a hot pixel.\n"
           "    shot_on, shot_off: (h, w) float32, the rates of shot noise in the dark, Hz.\n"
           "    refractory_us: (h, w) uint32, the refractory period of each pixel, 1 ... 2^30;\n"
           "        None for that of the settings.\n"
           "    threads: The number of threads; 0 for one per core.\n"
           "    isa: An instruction set of isa_available(), or auto.")
      .def("step", &BoundPixels::step_tick, nb::arg("luminance").noconvert(), nb::arg("t_begin_us"),
           nb::arg("clock_us"), nb::arg("tick_us"), nb::arg("ticks"), nb::kw_only(),
           nb::arg("reference").noconvert(), nb::arg("last_log").noconvert(),
           nb::arg("last_luminance").noconvert(),
           nb::arg("filtered").noconvert().none() = nb::none(),
           nb::arg("followed").noconvert().none() = nb::none(),
           nb::arg("blind_until").noconvert().none() = nb::none(),
           nb::arg("noise_budget").noconvert().none() = nb::none(),
           nb::arg("noise_mean").noconvert().none() = nb::none(),
           nb::arg("noise_memory").noconvert().none() = nb::none(),
           nb::arg("mean").noconvert().none() = nb::none(),
           nb::arg("noise").noconvert().none() = nb::none(),
           nb::arg("drift").noconvert().none() = nb::none(),
           nb::arg("due_us").noconvert().none() = nb::none(),
           nb::arg("since_us").noconvert().none() = nb::none(),
           nb::arg("shot_next").noconvert().none() = nb::none(),
           nb::arg("shot_count").noconvert().none() = nb::none(),
           nb::arg("row_reads").noconvert().none() = nb::none(), nb::arg("all_due") = false,
           "Step all pixels by one tick.\n"
           "\n"
           "The keyword arguments but the last two are the state and are modified in place.\n"
           "\n"
           "Args:\n"
           "    luminance: (h, w) float32.\n"
           "    t_begin_us: The stamp of the tick's start.\n"
           "    clock_us: The sensor's clock at the start: the sum of all ticks so far.\n"
           "    tick_us: The length of the tick.\n"
           "    ticks: The number of ticks so far.\n"
           "    row_reads: (n, 2) int32, rows of a frame that are read and when, us after the\n"
           "        start of the tick, by time; None for none.\n"
           "    all_due: Whether to skip no block, as after a change of the settings.\n"
           "\n"
           "Returns:\n"
           "    The event bytes, (16 n,) uint8, and the number of pixels with unusable\n"
           "    luminance.")
      .def("settle", &BoundPixels::settle, nb::arg("clock_us"), nb::kw_only(),
           nb::arg("reference").noconvert(), nb::arg("last_luminance").noconvert(),
           nb::arg("due_us").noconvert().none() = nb::none(),
           nb::arg("since_us").noconvert().none() = nb::none(),
           nb::arg("filtered").noconvert().none() = nb::none(),
           nb::arg("followed").noconvert().none() = nb::none(),
           nb::arg("noise_budget").noconvert().none() = nb::none(),
           nb::arg("mean").noconvert().none() = nb::none(),
           "Account for the leak and the noise of the ticks in which blocks were skipped, so\n"
           "that other settings may take the state over.\n"
           "\n"
           "Args:\n"
           "    clock_us: The sensor's clock.\n"
           "    reference, last_luminance, due_us, since_us, filtered, followed,\n"
           "        noise_budget, mean: The state, modified in place.");
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
