// The Python binding of the frames that a GPU renders.

#include "device_frame.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>

#include "bound_caster.h"
#include "gil.h"
#include "thread_pool.h"

namespace nb = nanobind;

namespace evs {
namespace {

struct BoundDeviceFrame {
  const BoundCaster& caster;
  DeviceFrame frame;
  bool adaptive;
};

BoundDeviceFrame* make_device_frame(BoundCaster& caster) {
  require(caster.caster.is_direct(), "only `direct` renders on a device");
  require(!caster.rgb, "a device renders luminance only");
  Caster::DeviceInputs inputs = caster.caster.device_inputs();
  return new BoundDeviceFrame{caster, DeviceFrame(caster.caster), inputs.first_pass.samples > 0};
}

void copy_constant(const BoundDeviceFrame& b, uint64_t address, Out<uint8_t, N> out) {
  require(out.shape(0) == b.frame.constant_bytes(), "out has constant_bytes");
  b.frame.copy_constant(address, reinterpret_cast<char*>(out.data()));
}

void copy_tick(const BoundDeviceFrame& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
               In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
               In<double, 9> camera_mat, uint64_t constant, uint64_t tick, Out<uint8_t, N> out,
               Out<uint8_t, N> frame, Out<uint8_t, N> first_pass) {
  require(out.shape(0) == b.frame.tick_bytes(), "out has tick_bytes");
  require(frame.shape(0) == sizeof(Frame) && first_pass.shape(0) == sizeof(Frame),
          "a frame has frame_bytes");
  Poses poses =
      checked_poses(b.caster, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  GilRelease release;
  Frame own, first;
  b.frame.copy_tick(poses, constant, tick, reinterpret_cast<char*>(out.data()), own, first);
  std::memcpy(frame.data(), &own, sizeof own);
  std::memcpy(first_pass.data(), &first, sizeof first);
}

// Render with the portable kernel what copies in this memory say, as a device does.
void trace_device_frame(In<uint8_t, N> frame, In<uint8_t, N> first_pass,
                        Out<float, N, N> luminance) {
  require(frame.shape(0) == sizeof(Frame) && first_pass.shape(0) == sizeof(Frame),
          "a frame has frame_bytes");
  Frame own, first;
  std::memcpy(&own, frame.data(), sizeof own);
  std::memcpy(&first, first_pass.data(), sizeof first);
  require(luminance.shape(0) == static_cast<size_t>(own.height) &&
              luminance.shape(1) == static_cast<size_t>(own.width),
          "luminance is (height, width)");
  GilRelease release;
  FlushDenormals flush;
  render_device_frame(*kernel_of("portable"), own, first, luminance.data());
}

}  // namespace

void bind_device_frame(nb::module_& m) {
  m.def("trace_device_frame", &trace_device_frame, nb::arg("frame"), nb::arg("first_pass"),
        nb::arg("luminance"),
        "Render a frame of DeviceFrame whose addresses are those of arrays, as a device does:\n"
        "for tests.\n"
        "\n"
        "Args:\n"
        "    frame, first_pass: (frame_bytes,) uint8, of copy_tick.\n"
        "    luminance: (h, w) float32, the output.");

  nb::class_<BoundDeviceFrame>(
      m, "DeviceFrame",
      "The frames of `direct` for a device with memory of its own.\n"
      "\n"
      "Everything that a frame points to lies in two blocks of memory: one\n"
      "that stays, and one that each tick replaces.")
      .def(nb::new_(&make_device_frame), nb::arg("caster"), nb::keep_alive<0, 1>(),
           "Args:\n"
           "    caster: Of `direct` without colour, whose meshes do not deform.")
      .def("copy_constant", &copy_constant, nb::arg("address"), nb::arg("out"),
           "Copy what stays.\n"
           "\n"
           "Args:\n"
           "    address: Where it will lie on the device.\n"
           "    out: (constant_bytes,) uint8, the output.")
      .def("copy_tick", &copy_tick, nb::arg("geom_pos"), nb::arg("geom_mat"), nb::arg("light_pos"),
           nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"), nb::arg("constant"),
           nb::arg("tick"), nb::arg("out"), nb::arg("frame"), nb::arg("first_pass"),
           "Place everything for a tick, and copy what it changes.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    constant, tick: Where the blocks lie on the device.\n"
           "    out: (tick_bytes,) uint8, the output.\n"
           "    frame: (frame_bytes,) uint8, out: the kernel's argument.\n"
           "    first_pass: (frame_bytes,) uint8, out: that of the first pass, if adaptive.")
      .def_prop_ro(
          "constant_bytes", [](const BoundDeviceFrame& b) { return b.frame.constant_bytes(); },
          "Bytes of what stays.")
      .def_prop_ro(
          "tick_bytes", [](const BoundDeviceFrame& b) { return b.frame.tick_bytes(); },
          "Bytes of what a tick changes.")
      .def_prop_ro(
          "frame_bytes", [](const BoundDeviceFrame&) { return sizeof(Frame); }, "Bytes of a frame.")
      .def_prop_ro(
          "adaptive", [](const BoundDeviceFrame& b) { return b.adaptive; },
          "Whether there is a first pass.");
}

}  // namespace evs
