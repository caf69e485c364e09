// The module evs.emulator._core.

#include <nanobind/nanobind.h>

namespace evs {
void bind_camera_batch(nanobind::module_& m);
void bind_caster(nanobind::module_& m);
void bind_device_frame(nanobind::module_& m);
void bind_device_pixels(nanobind::module_& m);
void bind_events(nanobind::module_& m);
void bind_network(nanobind::module_& m);
void bind_frame_light(nanobind::module_& m);
void bind_readout(nanobind::module_& m);
void bind_sampler_probe(nanobind::module_& m);
void bind_sensor(nanobind::module_& m);
void bind_watch(nanobind::module_& m);
}  // namespace evs

NB_MODULE(_core, m) {
  m.doc() = "The native core: the ray caster, the event pixel and the event network.";
  // threads that the interpreter stops at its exit leak what they used, which is not a bug of the
  // user
  nanobind::set_leak_warnings(false);
  evs::bind_camera_batch(m);
  evs::bind_caster(m);
  evs::bind_device_frame(m);
  evs::bind_device_pixels(m);
  evs::bind_events(m);
  evs::bind_network(m);
  evs::bind_frame_light(m);
  evs::bind_readout(m);
  evs::bind_sampler_probe(m);
  evs::bind_sensor(m);
  evs::bind_watch(m);
}
