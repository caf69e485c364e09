// The Python binding of the frames that a GPU renders.

#include "device_frame.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <cstddef>
#include <cstring>
#include <tuple>

#include "bound_device.h"

namespace nb = nanobind;

namespace evs {
namespace {

BoundDeviceFrame* make_device_frame(BoundCaster& caster) {
  require(caster.caster.fits_device(), "a device renders direct, or path with a fixed spp");
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
               Out<uint8_t, N> arguments, int seed) {
  require(out.shape(0) == b.frame.tick_bytes(), "out has tick_bytes");
  require(arguments.shape(0) == sizeof(DeviceArguments), "arguments have argument_bytes");
  Poses poses =
      checked_poses(b.caster, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  poses.seed = seed;
  GilRelease release;
  DeviceArguments made;
  b.frame.copy_tick(poses, constant, tick, reinterpret_cast<char*>(out.data()), made);
  std::memcpy(arguments.data(), &made, sizeof made);
}

// Render with the portable kernel what copies in this memory say, as a device does.
void trace_device_frame(In<uint8_t, N> arguments, Out<float, N, N> luminance) {
  require(arguments.shape(0) == sizeof(DeviceArguments), "arguments have argument_bytes");
  DeviceArguments made;
  std::memcpy(&made, arguments.data(), sizeof made);
  require(luminance.shape(0) == static_cast<size_t>(made.frame.height) &&
              luminance.shape(1) == static_cast<size_t>(made.frame.width),
          "luminance is (height, width)");
  GilRelease release;
  FlushDenormals flush;
  render_device_frame(*kernel_of("portable"), made, luminance.data());
}

}  // namespace

void bind_device_frame(nb::module_& m) {
  m.def("trace_device_frame", &trace_device_frame, nb::arg("arguments"), nb::arg("luminance"),
        "Render a frame of DeviceFrame whose addresses are those of arrays, as a device does:\n"
        "for tests.\n"
        "\n"
        "Args:\n"
        "    arguments: (argument_bytes,) uint8, of copy_tick.\n"
        "    luminance: (h, w) float32, the output.");

  nb::class_<BoundDeviceFrame>(
      m, "DeviceFrame",
      "The frames of `direct` or `path` for a device with memory of its own.\n"
      "\n"
      "Everything that a frame points to lies in two blocks of memory: one\n"
      "that stays, and one that each tick replaces.")
      .def(nb::new_(&make_device_frame), nb::arg("caster"), nb::keep_alive<0, 1>(),
           "Args:\n"
           "    caster: Of `direct`, or of `path` with a fixed number of samples; without colour.\n"
           "        Its meshes must not deform, nor with `path` its geoms be resized.")
      .def("copy_constant", &copy_constant, nb::arg("address"), nb::arg("out"),
           "Copy what stays.\n"
           "\n"
           "Args:\n"
           "    address: Where it will lie on the device.\n"
           "    out: (constant_bytes,) uint8, the output.")
      .def("copy_tick", &copy_tick, nb::arg("geom_pos"), nb::arg("geom_mat"), nb::arg("light_pos"),
           nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"), nb::arg("constant"),
           nb::arg("tick"), nb::arg("out"), nb::arg("arguments"), nb::arg("seed") = 0,
           "Place everything for a tick, and copy what it changes.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    constant, tick: Where the blocks lie on the device.\n"
           "    out: (tick_bytes,) uint8, the output.\n"
           "    arguments: (argument_bytes,) uint8, the output: those of the kernels.\n"
           "    seed: The seed of this tick, for path.")
      .def_prop_ro(
          "constant_bytes", [](const BoundDeviceFrame& b) { return b.frame.constant_bytes(); },
          "Bytes of what stays.")
      .def_prop_ro(
          "tick_bytes", [](const BoundDeviceFrame& b) { return b.frame.tick_bytes(); },
          "Bytes of what a tick changes.")
      .def_prop_ro(
          "argument_bytes", [](const BoundDeviceFrame&) { return sizeof(DeviceArguments); },
          "Bytes of the arguments.")
      .def_prop_ro(
          "argument_offsets",
          [](const BoundDeviceFrame&) {
            return std::make_tuple(offsetof(DeviceArguments, frame),
                                   offsetof(DeviceArguments, first_pass),
                                   offsetof(DeviceArguments, paths));
          },
          "Where in the arguments the frame is, that of a first pass, and that of paths.")
      .def_prop_ro(
          "adaptive", [](const BoundDeviceFrame& b) { return b.adaptive; },
          "Whether there is a first pass.");
}

}  // namespace evs
