// The Python binding of event pixels on a GPU.

#include "sensor/device_pixels.h"
#include "sensor/pixel_array.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <vector>

#include "bindings/bound_device.h"

namespace nb = nanobind;

namespace evs {
namespace {

DevicePixels device_pixels_of(const Array<const uint8_t, 1>& arguments) {
  if (arguments.shape(0) != sizeof(DevicePixels)) {
    throw std::invalid_argument("arguments have argument_bytes");
  }
  DevicePixels made;
  std::memcpy(&made, arguments.data(), sizeof made);
  return made;
}

// Step pixels whose arrays lie in this memory, as a device does.
void step_device_pixels(Array<const uint8_t, 1> arguments) {
  const DevicePixels d = device_pixels_of(arguments);
  GilRelease release;
  FlushDenormals flush;
  Scratch scratch;
  BudgetScratch budgets;
  NoisyPixels noisy;
  noisy.advance = advance_noisy;
  std::vector<ShotCandidate> shots;
  std::vector<Crossing> out;
  for (size_t block = 0; block < block_count(d.pixels); block++) {
    const size_t first = block * BLOCK_PIXELS;
    out.clear();
    const size_t count = std::min<size_t>(BLOCK_PIXELS, d.pixels - first);
    const size_t clamped = step_block(d.step, first, count, scratch, budgets, noisy, shots, out);
    if (d.step.arrays.photon_noise()) finish_noisy(d.step, noisy, first, out);
    std::copy_n(out.begin(), std::min<size_t>(out.size(), d.crossing_room),
                d.crossings + block * d.crossing_room);
    // those that are left behind, where a device counts all that it has drawn: only room for more
    d.counts[block] = {static_cast<uint32_t>(out.size()), static_cast<uint32_t>(shots.size()),
                       static_cast<uint32_t>(clamped)};
  }
}

// Find where the crossings of blocks go, by the threads of the kernel place_crossings.
void place_device_crossings(uint64_t counts, uint32_t blocks, uint64_t offsets, uint64_t all) {
  ScanSums<TickCounts> sums;
  place_crossings_of(at<const BlockCounts>(counts), blocks, at<uint32_t>(offsets), sums,
                     at<TickCounts>(all));
}

// Pack the crossings of blocks, by so many threads of the kernel pack_crossings.
void pack_device_crossings(size_t threads, uint64_t counts, uint32_t blocks, uint64_t crossings,
                           uint32_t crossing_room, uint64_t offsets, uint64_t all, uint32_t room,
                           uint64_t packed) {
  for (size_t thread = 0; thread < threads; thread++) {
    pack_crossings_of(thread, at<const BlockCounts>(counts), blocks, at<const Crossing>(crossings),
                      crossing_room, at<const uint32_t>(offsets), at<const TickCounts>(all), room,
                      at<Crossing>(packed));
  }
}

Bytes order_crossings(Array<const uint8_t, 1> crossings, int64_t t_begin_us, uint32_t tick_us,
                      uint32_t width, bool causes) {
  require(crossings.shape(0) % sizeof(Crossing) == 0, "crossings must be whole");
  BoundPixels::check_tick_us(tick_us);
  require(width >= 1 && width <= 32767, "width must be in [1, 32767]");
  std::vector<std::vector<Crossing>> parts(1);
  parts[0].resize(crossings.shape(0) / sizeof(Crossing));
  if (!parts[0].empty()) {
    std::memcpy(parts[0].data(), crossings.data(), parts[0].size() * sizeof(Crossing));
  }
  EventBuffer made;
  {
    GilRelease release;
    made = order_events(parts, t_begin_us, tick_us, width, causes);
  }
  return owned<Bytes>(std::move(made.events), made.count);
}

}  // namespace

void bind_device_pixels(nb::module_& m) {
  m.def("order_crossings", &order_crossings, nb::arg("crossings"), nb::arg("t_begin_us"),
        nb::arg("tick_us"), nb::arg("width"), nb::arg("causes"),
        "Sort what pixels of a device have found.\n"
        "\n"
        "Args:\n"
        "    crossings: (8 n,) uint8, in the order of the pixels.\n"
        "    t_begin_us: Where the tick begins, us.\n"
        "    tick_us: How long it is, us.\n"
        "    width: Of the image, px.\n"
        "    causes: Whether events hold their cause.\n"
        "\n"
        "Returns:\n"
        "    The bytes of the events, uint8.");
  m.def("step_device_pixels", &step_device_pixels, nb::arg("arguments"),
        "Step pixels of DevicePixels whose addresses are those of arrays, as a device does: for\n"
        "tests.\n"
        "\n"
        "Args:\n"
        "    arguments: (argument_bytes,) uint8.");
  m.def("place_device_crossings", &place_device_crossings, nb::arg("counts"), nb::arg("blocks"),
        nb::arg("offsets"), nb::arg("all"),
        "Run the kernel place_crossings on the CPU: for tests. Arrays are addresses.\n"
        "\n"
        "Args:\n"
        "    counts, blocks: Of each block of pixels, and how many blocks there are.\n"
        "    offsets: (blocks,) uint32, the output: where the crossings of each block begin.\n"
        "    all: (4,) uint32, the output: crossings, the most crossings and candidates of a\n"
        "        block, pixels with unusable luminance.");
  m.def("pack_device_crossings", &pack_device_crossings, nb::arg("threads"), nb::arg("counts"),
        nb::arg("blocks"), nb::arg("crossings"), nb::arg("crossing_room"), nb::arg("offsets"),
        nb::arg("all"), nb::arg("room"), nb::arg("packed"),
        "Run the kernel pack_crossings on the CPU: for tests. Arrays are addresses.\n"
        "\n"
        "Args:\n"
        "    threads: How many are launched.\n"
        "    counts, blocks: See `place_device_crossings`.\n"
        "    crossings, crossing_room: Of each block, and room for how many it has.\n"
        "    offsets, all: What place_device_crossings found.\n"
        "    room: How many crossings there is room for.\n"
        "    packed: The crossings, the output.");
  nb::class_<BoundDevicePixels>(
      m, "DevicePixels",
      "The arguments of kernels that step event pixels on a device with memory of its own.")
      .def(nb::init<const BoundPixels&>(), nb::arg("pixels"), nb::keep_alive<1, 2>(),
           "Args:\n"
           "    pixels: Whose fixed pattern and settings they have.")
      .def("copy_constant", &BoundDevicePixels::copy_constant, nb::arg("address"), nb::arg("out"),
           "Copy what stays.\n"
           "\n"
           "Args:\n"
           "    address: Where it will lie on the device.\n"
           "    out: (constant_bytes,) uint8, the output.")
      .def(
          "copy_arguments", &BoundDevicePixels::copy_arguments, nb::kw_only(), nb::arg("constant"),
          nb::arg("arrays"), nb::arg("luminance"), nb::arg("clock_us"), nb::arg("tick_us"),
          nb::arg("ticks"), nb::arg("all_due"), nb::arg("row_reads"), nb::arg("row_read_count"),
          nb::arg("room"), nb::arg("out"),
          "Write the argument of the kernels for a tick.\n"
          "\n"
          "Args:\n"
          "    constant: Where what stays lies on the device.\n"
          "    arrays: Where each array of the state lies, by name.\n"
          "    luminance: Where the (h, w) float32 light lies.\n"
          "    clock_us, tick_us, ticks, all_due: See `PixelArray.step`.\n"
          "    row_reads, row_read_count: Where (n, 2) int32 row reads lie, and n.\n"
          "    room: crossings, crossing_room, candidates, candidate_room, counts: where there is\n"
          "        room for (blocks, crossing_room) crossings of 8 bytes, (blocks, "
          "candidate_room)\n"
          "        candidates of 16 and (blocks,) counts of 12.\n"
          "    out: (argument_bytes,) uint8, the output.")
      .def_prop_ro("constant_bytes", &BoundDevicePixels::constant_bytes, "Bytes of what stays.")
      .def_prop_ro(
          "argument_bytes", [](const BoundDevicePixels&) { return sizeof(DevicePixels); },
          "Bytes of the argument.");
}

}  // namespace evs
