// Python's view of the sensor: PlainSensor, and the log functions that tests compare with NumPy.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include "plain.h"

namespace nb = nanobind;

namespace evs {
namespace {

using Line = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using FrameIn = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using FrameOut = nb::ndarray<float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using DoubleOut = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using Floats = nb::ndarray<nb::numpy, float, nb::ndim<1>>;

LogMap make_log_map(const std::string& log, float exposure_dn, float dark_dn, float linlog_dn,
                    float log_eps) {
  if (log == "linlog") return LogMap::linlog(exposure_dn, dark_dn, linlog_dn);
  if (log == "log_eps") return LogMap::log_eps(exposure_dn, dark_dn, log_eps);
  throw std::invalid_argument("log must be linlog or log_eps, not " + log);
}

// An array that owns `data`.
template <class Array, class T>
Array owned(std::unique_ptr<T[]> data, size_t count) {
  nb::capsule owner(data.get(), [](void* p) noexcept { delete[] static_cast<T*>(p); });
  T* memory = data.release();
  return Array(memory, {count * sizeof(T) / sizeof(typename Array::Scalar)}, owner);
}

class PlainSensorBinding {
 public:
  PlainSensorBinding(int width, int height, const std::string& log, float exposure_dn,
                     float dark_dn, float linlog_dn, float log_eps, int threads,
                     const std::string& isa)
      : width_(static_cast<size_t>(width)),
        height_(static_cast<size_t>(height)),
        sensor_(make_log_map(log, exposure_dn, dark_dn, linlog_dn, log_eps), width, height, threads,
                isa) {}

  nb::tuple step(FrameIn luminance, FrameIn theta_on, FrameIn theta_off, DoubleOut reference,
                 FrameOut last_log, FrameOut last_luminance, int64_t t_begin_us, int64_t tick_us) {
    auto check = [&](const auto& frame) {
      if (frame.shape(0) != height_ || frame.shape(1) != width_) {
        throw std::invalid_argument("every array must be (height, width)");
      }
    };
    check(luminance);
    check(theta_on);
    check(theta_off);
    check(reference);
    check(last_log);
    check(last_luminance);
    if (tick_us <= 0 || tick_us >= (int64_t{1} << 30)) {
      throw std::invalid_argument("tick_us must be in [1, 2^30)");
    }
    const PixelArrays pixels{luminance.data(), theta_on.data(), theta_off.data(),
                             reference.data(), last_log.data(), last_luminance.data()};
    EventBuffer buffer;
    size_t clamped = 0;
    {
      nb::gil_scoped_release release;
      buffer = sensor_.step(pixels, t_begin_us, static_cast<uint32_t>(tick_us), clamped);
    }
    return nb::make_tuple(owned<Bytes>(std::move(buffer.events), buffer.count), clamped);
  }

 private:
  size_t width_;
  size_t height_;
  PlainSensor sensor_;
};

Floats natural_log(Line values) {
  std::unique_ptr<float[]> out(new float[values.shape(0)]);
  for (size_t i = 0; i < values.shape(0); i++) out[i] = ln(values.data()[i]);
  return owned<Floats>(std::move(out), values.shape(0));
}

Floats log_map(Line luminance, const std::string& log, float exposure_dn, float dark_dn,
               float linlog_dn, float log_eps) {
  const LogMap map = make_log_map(log, exposure_dn, dark_dn, linlog_dn, log_eps);
  const size_t count = luminance.shape(0);
  std::unique_ptr<float[]> out(new float[count]);
  for (size_t i = 0; i < count; i++) {
    const float dn = to_dn(map, luminance.data()[i]);
    const float mapped = map.kind == LogKind::linlog ? to_log<LogKind::linlog>(map, dn)
                                                     : to_log<LogKind::log_eps>(map, dn);
    out[i] = is_light(luminance.data()[i], dn) ? mapped : std::bit_cast<float>(0x7fc00000u);
  }
  return owned<Floats>(std::move(out), count);
}

}  // namespace

void bind_sensor(nb::module_& m) {
  nb::class_<PlainSensorBinding>(m, "PlainSensor",
                                 "A sensor of plain pixels: see evs.emulator.sensor.plain.")
      .def(nb::init<int, int, const std::string&, float, float, float, float, int,
                    const std::string&>(),
           nb::arg("width"), nb::arg("height"), nb::arg("log"), nb::arg("exposure_dn"),
           nb::arg("dark_dn"), nb::arg("linlog_dn"), nb::arg("log_eps"), nb::arg("threads"),
           nb::arg("isa") = "auto")
      .def("step", &PlainSensorBinding::step, nb::arg("luminance").noconvert(),
           nb::arg("theta_on").noconvert(), nb::arg("theta_off").noconvert(),
           nb::arg("reference").noconvert(), nb::arg("last_log").noconvert(),
           nb::arg("last_luminance").noconvert(), nb::arg("t_begin_us"), nb::arg("tick_us"),
           "Out: (the events' bytes (16 n,) uint8, how many pixels had no usable light). "
           "reference, last_log and last_luminance are changed in place.");
  m.def("natural_log", &natural_log, nb::arg("values").noconvert(),
        "ln of normal positive float32 (n,), the sensor's own.");
  m.def("log_map", &log_map, nb::arg("luminance").noconvert(), nb::arg("log"),
        nb::arg("exposure_dn"), nb::arg("dark_dn"), nb::arg("linlog_dn"), nb::arg("log_eps"),
        "Log light of linear luminance (n,); NaN where the luminance is negative, NaN or Inf.");
}

}  // namespace evs
