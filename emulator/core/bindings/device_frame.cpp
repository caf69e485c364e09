// The Python binding of the frames that a GPU renders.

#include "render/device_frame.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <tuple>
#include <vector>

#include "bindings/bound_device.h"
#include "render/irradiance/first_readers.h"

namespace nb = nanobind;

namespace evs {
namespace {

BoundDeviceFrame* make_device_frame(BoundCaster& caster) {
  require(caster.caster.fits_device(), "a device renders paths with a fixed spp only");
  require(!caster.rgb, "a device renders luminance only");
  Caster::DeviceInputs inputs = caster.caster.device_inputs();
  return new BoundDeviceFrame{caster, DeviceFrame(caster.caster), inputs.first_pass.samples > 0};
}

void copy_constant(const BoundDeviceFrame& b, uint64_t address, Out<uint8_t, N> out) {
  require(out.shape(0) == b.frame.constant_bytes(), "out has constant_bytes");
  b.frame.copy_constant(address, reinterpret_cast<char*>(out.data()));
}

const char* copy_tick(const BoundDeviceFrame& b, In<double, N, 3> geom_pos,
                      In<double, N, 9> geom_mat, In<double, N, 3> light_pos,
                      In<double, N, 3> light_dir, In<double, 3> camera_pos,
                      In<double, 9> camera_mat, uint64_t constant, uint64_t tick,
                      Out<uint8_t, N> out, Out<uint8_t, N> arguments, int seed) {
  require(out.shape(0) == b.frame.tick_bytes(), "out has tick_bytes");
  require(arguments.shape(0) == sizeof(DeviceArguments), "arguments have argument_bytes");
  Poses poses =
      checked_poses(b.caster, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  poses.seed = seed;
  GilRelease release;
  DeviceArguments made;
  Caster::Place place =
      b.frame.copy_tick(poses, constant, tick, reinterpret_cast<char*>(out.data()), made);
  std::memcpy(arguments.data(), &made, sizeof made);
  return place == Caster::Place::THERE ? "there" : "nowhere";
}

const IrradianceCache& cache_of(const BoundDeviceFrame& b) {
  const HybridIntegrator* hybrid = b.frame.caster().hybrid();
  require(hybrid, "only hybrid has a cache");
  return hybrid->irradiance();
}

void copy_cache(const BoundDeviceFrame& b, bool edges, uint64_t address, uint64_t used_address,
                Out<uint8_t, N> out, Out<uint8_t, N> used, Out<uint8_t, N> arguments) {
  require(used.shape(0) == static_cast<size_t>(cache_of(b).size()), "used has a byte a node");
  require(out.shape(0) == b.frame.cache_bytes(), "out has cache_bytes");
  require(arguments.shape(0) == sizeof(DeviceArguments), "arguments have argument_bytes");
  DeviceArguments made;
  std::memcpy(&made, arguments.data(), sizeof made);
  b.frame.copy_cache(edges, address, used_address, reinterpret_cast<char*>(out.data()), used.data(),
                     made);
  std::memcpy(arguments.data(), &made, sizeof made);
}

bool take_nodes(const BoundDeviceFrame& b, In<uint8_t, N> used, In<uint8_t, N> missing) {
  require(used.shape(0) == static_cast<size_t>(cache_of(b).size()), "used has a byte a node");
  require(missing.shape(0) % sizeof(NodeRequest) == 0, "missing has request_bytes a node");
  std::vector<NodeRequest> requests(missing.shape(0) / sizeof(NodeRequest));
  if (!requests.empty()) std::memcpy(requests.data(), missing.data(), missing.shape(0));
  GilRelease release;
  return b.frame.take_from_device(used.data(), requests.data(), requests.size());
}

void trace_here(const BoundDeviceFrame& b, Out<float, N, N> luminance) {
  cache_of(b);
  require(luminance.shape(0) == b.caster.height && luminance.shape(1) == b.caster.width,
          "luminance is (height, width)");
  GilRelease release;
  b.frame.trace_here(luminance.data());
}

void take_readers(const BoundDeviceFrame& b, In<uint64_t, N, HIT_WORDS> first) {
  require(first.shape(0) == static_cast<size_t>(cache_of(b).size()), "first has a row a node");
  b.frame.take_first_readers(first.data());
}

// A pass of `hybrid` with the portable kernel, as a device does it. Adds the numbers of missing
// nodes and of readers to `counts`.
void trace_device_pass(In<uint8_t, N> arguments, bool edges, uint64_t counts, uint64_t missing,
                       uint32_t missing_room, uint64_t readers, uint32_t reader_room, uint64_t base,
                       uint64_t untextured, uint64_t luminance) {
  require(arguments.shape(0) == sizeof(DeviceArguments), "arguments have argument_bytes");
  DeviceArguments made;
  std::memcpy(&made, arguments.data(), sizeof made);
  GilRelease release;
  FlushDenormals flush;
  DeviceNodes found;
  trace_device_pixels(*kernel_of("portable"), made, edges,
                      {at<const float>(base), at<float>(untextured), at<float>(luminance)}, found);
  auto hand_out = [](const auto& from, uint32_t& count, auto* to, uint32_t room) {
    count += static_cast<uint32_t>(from.size());
    std::copy_n(from.begin(), std::min<size_t>(from.size(), room), to);
  };
  hand_out(found.missing, at<uint32_t>(counts)[0], at<NodeRequest>(missing), missing_room);
  hand_out(found.readers, at<uint32_t>(counts)[1], at<CellReader>(readers), reader_room);
}

// A launch of the kernel that offers a word of each reader.
void offer_device_readers(uint64_t readers, uint32_t count, int word, uint64_t first) {
  for (uint32_t i = 0; i < count; i++) {
    offer_word(at<const CellReader>(readers)[i], word, at<uint64_t>(first),
               [](uint64_t* place, uint64_t value) { *place = std::min(*place, value); });
  }
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

  m.def("offer_device_readers", &offer_device_readers, nb::arg("readers"), nb::arg("count"),
        nb::arg("word"), nb::arg("first"),
        "Offer a word of each reader to the nodes that it reads, as a device does: for tests.\n"
        "\n"
        "Args:\n"
        "    readers, count: The address of so many readers of reader_bytes.\n"
        "    word: Which of the words, after those before.\n"
        "    first: The address of (nodes, 3) uint64, the least words so far.");
  m.def("trace_device_pass", &trace_device_pass, nb::arg("arguments"), nb::arg("edges"),
        nb::arg("counts"), nb::arg("missing"), nb::arg("missing_room"), nb::arg("readers"),
        nb::arg("reader_room"), nb::arg("base"), nb::arg("untextured"), nb::arg("luminance"),
        "Trace a pass of `hybrid` from DeviceFrame's copies, whose addresses are those of\n"
        "arrays, as a device does: for tests.\n"
        "\n"
        "Args:\n"
        "    arguments: (argument_bytes,) uint8, of copy_tick and copy_cache.\n"
        "    edges: Whether pixels at edges are refined; else all are traced.\n"
        "    counts: The address of two uint32, to which the numbers of missing nodes and of\n"
        "        readers are added.\n"
        "    missing, missing_room: The address of so many nodes of request_bytes.\n"
        "    readers, reader_room: The address of so many readers of reader_bytes.\n"
        "    base, untextured, luminance: Addresses of (h, w) float32: light of the first pass,\n"
        "        where edges are refined; light without textures, or 0; the light.");

  nb::class_<BoundDeviceFrame>(
      m, "DeviceFrame",
      "The frames of a renderer for a device with memory of its own.\n"
      "\n"
      "Everything that a frame points to lies in two blocks of memory: one\n"
      "that stays, and one that each tick replaces. What `hybrid` reads of its\n"
      "cache lies in a third one, which each pass over the pixels replaces.")
      .def(nb::new_(&make_device_frame), nb::arg("caster"), nb::keep_alive<0, 1>(),
           "Args:\n"
           "    caster: Of `direct`, `hybrid`, or `path` with a fixed number of samples; without\n"
           "        colour. Its meshes must not deform, nor with `path` and `hybrid` its geoms be\n"
           "        resized.")
      .def("copy_constant", &copy_constant, nb::arg("address"), nb::arg("out"),
           "Copy what stays.\n"
           "\n"
           "Args:\n"
           "    address: Where it will lie on the device.\n"
           "    out: (constant_bytes,) uint8, the output.")
      .def("copy_tick", &copy_tick, nb::arg("geom_pos"), nb::arg("geom_mat"), nb::arg("light_pos"),
           nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"), nb::arg("constant"),
           nb::arg("tick"), nb::arg("out"), nb::arg("arguments"), nb::arg("seed") = 0,
           "Place everything for a tick, light nodes of `hybrid`, and copy what the tick changes.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    constant, tick: Where the blocks lie on the device.\n"
           "    out: (tick_bytes,) uint8, the output.\n"
           "    arguments: (argument_bytes,) uint8, the output: those of the kernels.\n"
           "    seed: The seed of this tick, for path and hybrid.\n"
           "\n"
           "Returns:\n"
           "    Where pixels are to be traced: \"there\", or \"nowhere\", as no light has changed.")
      .def("copy_cache", &copy_cache, nb::arg("edges"), nb::arg("address"), nb::arg("used_address"),
           nb::arg("out"), nb::arg("used"), nb::arg("arguments"),
           "Begin a pass of `hybrid`, after copy_tick, and copy what it reads of the cache.\n"
           "\n"
           "Args:\n"
           "    edges: Whether it is that over pixels at edges.\n"
           "    address, used_address: Where `out` and `used` lie on the device.\n"
           "    out: (cache_bytes,) uint8, the output.\n"
           "    used: (nodes,) uint8, the output; the device adds to it.\n"
           "    arguments: (argument_bytes,) uint8 of copy_tick, changed.")
      .def("take_nodes", &take_nodes, nb::arg("used"), nb::arg("missing"),
           "Take what a pass has read, and light the nodes that it missed.\n"
           "\n"
           "Args:\n"
           "    used: (nodes,) uint8.\n"
           "    missing: (n * request_bytes,) uint8.\n"
           "\n"
           "Returns:\n"
           "    False where the cache has no room, or was empty: the tick is then traced by\n"
           "    trace_here.")
      .def(
          "take_readers", &take_readers, nb::arg("first"),
          "Take from where nodes are read, after a pass in which nothing was missing.\n"
          "\n"
          "Args:\n"
          "    first: (nodes, 3) uint64, the least words of all readers of each; all bits 1: none.")
      .def("trace_here", &trace_here, nb::arg("luminance"),
           "Trace the pixels of `hybrid` on the CPU, after copy_tick.\n"
           "\n"
           "Args:\n"
           "    luminance: (h, w) float32, the output.")
      .def_prop_ro(
          "cache_bytes",
          [](const BoundDeviceFrame& b) {
            cache_of(b);
            return b.frame.cache_bytes();
          },
          "Bytes of the cache as it is now, of `hybrid`.")
      .def_prop_ro(
          "nodes", [](const BoundDeviceFrame& b) { return cache_of(b).size(); },
          "Nodes of the cache, of `hybrid`.")
      .def_prop_ro(
          "request_bytes", [](const BoundDeviceFrame&) { return sizeof(NodeRequest); },
          "Bytes of a missing node.")
      .def_prop_ro(
          "reader_bytes", [](const BoundDeviceFrame&) { return sizeof(CellReader); },
          "Bytes of a hit that reads nodes.")
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
            return std::make_tuple(
                offsetof(DeviceArguments, frame), offsetof(DeviceArguments, first_pass),
                offsetof(DeviceArguments, paths), offsetof(DeviceArguments, cache));
          },
          "Where in the arguments the frame is, that of a first pass, that of paths, and the "
          "cache.")
      .def_prop_ro(
          "adaptive", [](const BoundDeviceFrame& b) { return b.adaptive; },
          "Whether there is a first pass.");
}

}  // namespace evs
