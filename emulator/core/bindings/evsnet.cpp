// Python binding of EvSNet: NetworkArray, the runtime `native`, and what it takes to run it on a
// GPU.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstring>
#include <mutex>
#include <optional>
#include <vector>

#include "bindings/gil.h"
#include "bindings/values.h"
#include "evsnet/device_constants.h"
#include "evsnet/network_array.h"

namespace evs {
namespace {

using Line = Array<const float, 1>;

// Copies of the parameters, which nothing in Python can change.
struct Parameters {
  std::vector<float> weights, biases, pointwise, decay_low, decay_high;
  std::vector<int32_t> delays;
};

class BoundNetwork {
 public:
  BoundNetwork(int width, int height, nb::object parameters, int64_t tick_us, bool dense,
               int threads, const std::string& isa) {
    Line weights, last, decay_low, decay_high;
    Array<const float, 2> biases;
    Array<const int32_t, 1> delays;
    float last_bias = 0.0f, v_on = 0.0f, v_off = 0.0f;
    float exposure_dn = 0.0f, dark_dn = 0.0f, linlog_dn = 0.0f;
    int most = 0;
    const Fields field(parameters);
    field("weights", weights);
    field("biases", biases);
    field("delays", delays);
    field("last", last);
    field("last_bias", last_bias);
    field("v_on", v_on);
    field("v_off", v_off);
    field("most", most);
    field("decay_low", decay_low);
    field("decay_high", decay_high);
    field("exposure_dn", exposure_dn);
    field("dark_dn", dark_dn);
    field("linlog_dn", linlog_dn);
    require(width >= 1 && width <= 32767 && height >= 1 && height <= 32767,
            "width and height must be in [1, 32767]");
    require(last.shape(0) >= 1 && last.shape(0) <= 64, "1 ... 64 channels are possible");
    require(delays.shape(0) <= 8, "at most 8 blocks are possible");
    require(tick_us >= 1 && tick_us < (int64_t{1} << 28), "tick_us must be in [1, 2^28)");
    require(v_on > 0.0f && v_off > 0.0f, "thresholds must be over 0");
    require(most >= 1 && most <= MOST_SPIKES, "1 ... 64 events per tick are possible");
    require(decay_low.shape(0) == DECAY_LOW && decay_high.shape(0) == DECAY_HIGH,
            "decay tables must have 256 and 4096 entries");
    parameters_.weights.assign(weights.data(), weights.data() + weights.size());
    parameters_.biases.assign(biases.data(), biases.data() + biases.size());
    parameters_.delays.assign(delays.data(), delays.data() + delays.size());
    parameters_.pointwise.assign(last.data(), last.data() + last.size());
    parameters_.decay_low.assign(decay_low.data(), decay_low.data() + decay_low.size());
    parameters_.decay_high.assign(decay_high.data(), decay_high.data() + decay_high.size());
    for (int32_t delay : parameters_.delays) {
      require(delay >= 0 && delay <= FIFO_TICKS, "delays must be 0 ... 6 ticks");
    }
    NetworkSettings settings;
    settings.map = LogMap::linlog(exposure_dn, dark_dn, linlog_dn);
    Network& network = settings.network;
    network.channels = static_cast<int>(parameters_.pointwise.size());
    network.blocks = static_cast<int>(parameters_.delays.size());
    require(weights.shape(0) == network.weight_floats(), "weights are for another network");
    require(biases.shape(0) == static_cast<size_t>(network.convolutions()) &&
                biases.shape(1) == static_cast<size_t>(network.channels),
            "biases must be (convolutions, channels)");
    network.weights = parameters_.weights.data();
    network.biases = parameters_.biases.data();
    network.delays = parameters_.delays.data();
    network.pointwise = parameters_.pointwise.data();
    network.pointwise_bias = last_bias;
    settings.bilif = {v_on, v_off, most, parameters_.decay_low.data(),
                      parameters_.decay_high.data()};
    settings.tick_us = tick_us;
    settings.dense = dense;
    width_ = static_cast<size_t>(width);
    height_ = static_cast<size_t>(height);
    row_floats_ = network.row_floats();
    tick_us_ = tick_us;
    array_ = std::make_unique<NetworkArray>(settings, width, height, threads, isa);
  }

  nb::tuple step(Array<const float, 3> luminance, int64_t tick, int64_t begin_us,
                 Array<float, 2> last_luminance, Array<float, 2> last_log, Array<float, 2> v,
                 Array<int64_t, 2> last, Array<float, 2> fifo, Array<int32_t, 2> tile_row,
                 Array<int64_t, 3> tile_moved, Array<uint8_t, 2> tile_loud, nb::callable grow,
                 std::optional<Array<float, 3>> currents) {
    constexpr int64_t END = int64_t{1} << 56;
    const size_t ticks = luminance.shape(0), frame = width_ * height_;
    require(luminance.shape(1) == height_ && luminance.shape(2) == width_,
            "luminance must be (ticks, height, width)");
    require(ticks < (size_t{1} << 24), "too many ticks at once");
    require(tick >= 0 && tick < END, "tick must be in [0, 2^56)");
    require(begin_us > -END && begin_us < END, "begin_us must be in (-2^56, 2^56)");
    require(!currents || (currents->shape(0) == ticks && currents->shape(1) == height_ &&
                          currents->shape(2) == width_),
            "currents must have the shape of luminance");
    require(fifo.shape(1) == row_floats_, "fifo is of another network");
    NetworkArrays arrays;
    arrays.last_luminance = pixels(last_luminance);
    arrays.last_log = pixels(last_log);
    arrays.v = pixels(v);
    arrays.last = pixels(last);
    arrays.fifo = fifo.data();
    arrays.rows = fifo.shape(0);
    arrays.tile_row = of_tiles(tile_row);
    arrays.tile_moved = of_lanes(tile_moved);
    arrays.tile_loud = of_tiles(tile_loud);

    // `grown` keeps the larger memory alive during the call; `grow` has stored it by then
    nb::object grown;
    auto more = [&](size_t rows) {
      GilAcquire hold;
      grown = grow(rows);
      Array<float, 2> larger = nb::cast<Array<float, 2>>(grown, false);
      require(larger.shape(0) >= rows && larger.shape(1) == row_floats_,
              "grow must give the rows it was asked for");
      arrays.fifo = larger.data();
      arrays.rows = larger.shape(0);
      return arrays.fifo;
    };
    NetworkCounts counts;
    nb::list events;
    for (size_t done = 0; done < ticks; done += TICK_CHUNK) {
      NetworkChunk chunk;
      chunk.luminance = luminance.data() + done * frame;
      chunk.ticks = static_cast<int>(std::min<size_t>(TICK_CHUNK, ticks - done));
      chunk.tick = tick + static_cast<int64_t>(done);
      chunk.begin_us = begin_us + static_cast<int64_t>(done) * tick_us_;
      chunk.currents = currents ? currents->data() + done * frame : nullptr;
      std::vector<EventBuffer> buffers;
      {
        GilRelease release;
        std::lock_guard one_caller(callers_);
        buffers = array_->step(arrays, chunk, more, counts);
      }
      for (EventBuffer& buffer : buffers)
        events.append(owned<Bytes>(std::move(buffer.events), buffer.count));
    }
    return nb::make_tuple(events, counts.clamped, counts.x_clamped, counts.v_clamped);
  }

  size_t row_floats() const { return row_floats_; }
  const NetworkArray& array() const { return *array_; }
  nb::tuple tiles() const { return nb::make_tuple(array_->tiles_down(), array_->tiles_across()); }

 private:
  template <class T>
  T* pixels(const Array<T, 2>& array) const {
    require(array.shape(0) == height_ && array.shape(1) == width_,
            "every array of pixels must be (height, width)");
    return array.data();
  }
  template <class T>
  T* of_tiles(const Array<T, 2>& array) const {
    require(array.shape(0) == array_->tiles_down() && array.shape(1) == array_->tiles_across(),
            "every array of tiles must be as `tiles` says");
    return array.data();
  }

  int64_t* of_lanes(const Array<int64_t, 3>& array) const {
    require(array.shape(0) == array_->tiles_down() && array.shape(1) == array_->tiles_across() &&
                array.shape(2) == TILE_LANES,
            "tile_moved must be of 16 pixels a tile");
    return array.data();
  }

  Parameters parameters_;
  size_t width_, height_, row_floats_;
  int64_t tick_us_;
  std::mutex callers_;  // one call at a time: the scratch memory is shared
  std::unique_ptr<NetworkArray> array_;
};

Bytes constants_of(const DeviceConstants& constants, uint64_t address) {
  char* out = new char[constants.bytes()]();
  nb::capsule owner(out, [](void* p) noexcept { delete[] static_cast<char*>(p); });
  constants.copy(address, out);
  return Bytes(reinterpret_cast<uint8_t*>(out), {constants.bytes()}, owner);
}

Bytes argument_of(const DeviceConstants& constants, uint64_t address, uint64_t last_luminance,
                  uint64_t last_log, uint64_t v, uint64_t last, uint64_t moved, uint64_t fifo,
                  uint64_t current, uint64_t leaked, uint64_t marks, uint64_t groups,
                  uint64_t totals) {
  const DeviceNetworkArrays arrays = {
      at<float>(last_luminance), at<float>(last_log),  at<float>(v),        at<int64_t>(last),
      at<int64_t>(moved),        at<float>(fifo),      at<float>(current),  at<float>(leaked),
      at<uint16_t>(marks),       at<uint32_t>(groups), at<uint32_t>(totals)};
  auto* made = new DeviceNetwork(constants.argument(address, arrays));
  nb::capsule owner(made, [](void* p) noexcept { delete static_cast<DeviceNetwork*>(p); });
  return Bytes(reinterpret_cast<uint8_t*>(made), {sizeof(DeviceNetwork)}, owner);
}

using Argument = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

void launch_kernel(const std::string& kernel, size_t blocks, size_t threads,
                   const std::vector<Argument>& arguments) {
  std::vector<const void*> places;
  for (size_t i = 0; i < arguments.size(); i++) {
    require(arguments[i].nbytes() == (i == 0 ? sizeof(DeviceNetwork) : sizeof(uint64_t)),
            "the first argument is that of DeviceNetwork, the others have 8 bytes");
    places.push_back(arguments[i].data());
  }
  GilRelease release;
  FlushDenormals flush;
  run_network_kernel(kernel, blocks, threads, places);
}

}  // namespace

void bind_network(nb::module_& m) {
  nb::class_<BoundNetwork>(m, "NetworkArray",
                           "EvSNet on an array of pixels. The caller owns the state.")
      .def(nb::init<int, int, nb::object, int64_t, bool, int, const std::string&>(),
           nb::arg("width"), nb::arg("height"), nb::arg("parameters"), nb::kw_only(),
           nb::arg("tick_us"), nb::arg("dense") = false, nb::arg("threads") = 0,
           nb::arg("isa") = "auto",
           "Args:\n"
           "    parameters: An object with the attributes weights ... linlog_dn.\n"
           "    weights: The weights of all convolutions, one after another, each (out, in,\n"
           "        7).\n"
           "    biases: (convolutions, channels).\n"
           "    delays: (blocks,), the delay of each residual sum, ticks.\n"
           "    last, last_bias: (channels,), the weights and the bias of the point-wise\n"
           "        convolution.\n"
           "    v_on, v_off: The thresholds of the membrane potential.\n"
           "    most: The largest number of events of a pixel in a tick, 1 ... 64.\n"
           "    decay_low, decay_high: (256,) d^m and (4096,) d^(256 m), where d is the\n"
           "        leak of a tick.\n"
           "    exposure_dn, dark_dn, linlog_dn: The map from luminance to log intensity,\n"
           "        DN.\n"
           "    tick_us: The length of a tick, us.\n"
           "    dense: Compute every tile in every tick.\n"
           "    threads: The number of threads; 0 for one per core.\n"
           "    isa: An instruction set of isa_available(), or auto.")
      .def("step", &BoundNetwork::step, nb::arg("luminance").noconvert(), nb::arg("tick"),
           nb::arg("begin_us"), nb::kw_only(), nb::arg("last_luminance").noconvert(),
           nb::arg("last_log").noconvert(), nb::arg("v").noconvert(), nb::arg("last").noconvert(),
           nb::arg("fifo").noconvert(), nb::arg("tile_row").noconvert(),
           nb::arg("tile_moved").noconvert(), nb::arg("tile_loud").noconvert(), nb::arg("grow"),
           nb::arg("currents").noconvert().none() = nb::none(),
           "Step a chunk of ticks.\n"
           "\n"
           "All arrays except luminance are modified in place.\n"
           "\n"
           "Args:\n"
           "    luminance: (ticks, h, w) float32.\n"
           "    tick: The number of the first tick.\n"
           "    begin_us: Where the first tick begins, us.\n"
           "    grow: grow(rows) must copy fifo to an array with more rows, the new ones\n"
           "        zero, and return it.\n"
           "    currents: (ticks, h, w) float32, the output of the convolutions; None if\n"
           "        not wanted.\n"
           "\n"
           "Returns:\n"
           "    The event bytes of each tick, (16 n,) uint8; the number of pixels whose\n"
           "    luminance was replaced, whose X was clamped and whose V was clamped.")
      .def_prop_ro(
          "row_floats", &BoundNetwork::row_floats,
          "The floats in the FIFOs of a tile: [16][6][feature]; tick n is in slot n mod 6.")
      .def_prop_ro("tiles", &BoundNetwork::tiles,
                   "The number of tiles of 4 x 4 pixels, (down, across).");

  nb::class_<DeviceConstants>(m, "DeviceNetwork",
                              "EvSNet on a device with memory of its own: what its kernels read.")
      .def(nb::new_(
               [](const BoundNetwork& network) { return new DeviceConstants(network.array()); }),
           nb::arg("network"), nb::keep_alive<0, 1>(),
           "Args:\n"
           "    network: Size, network and unit; its threads stay unused.")
      .def("constants", &constants_of, nb::arg("address"),
           "Return (n,) uint8, the block of memory that stays.\n"
           "\n"
           "Args:\n"
           "    address: Where it will lie on the device.")
      .def("argument", &argument_of, nb::arg("constants"), nb::kw_only(), nb::arg("last_luminance"),
           nb::arg("last_log"), nb::arg("v"), nb::arg("last"), nb::arg("moved"), nb::arg("fifo"),
           nb::arg("current"), nb::arg("leaked"), nb::arg("marks"), nb::arg("groups"),
           nb::arg("totals"),
           "Return (n,) uint8, the first argument of every kernel.\n"
           "\n"
           "Args:\n"
           "    constants: Where that block lies on the device, as all others.\n"
           "    last_luminance, last_log, v: (h, w) float32, of the state.\n"
           "    last, moved: (h, w) int64, of the state: the tick of v, the last one with X != 0.\n"
           "    fifo: (6, feature, h, w) float32, of the state; tick n is in slot n mod 6.\n"
           "    current, leaked: (h, w) float32, written in each tick.\n"
           "    marks: (h, w) uint16, what each pixel did in a tick.\n"
           "    groups: (4, groups) uint32, counts of groups of `group` pixels.\n"
           "    totals: (4,) uint32, those of all: spikes, pixels whose luminance was replaced,\n"
           "        whose X was clamped and whose V was clamped.")
      .def_prop_ro_static(
          "group", [](nb::handle) { return TILE_GROUP; }, "The pixels of a group.")
      .def_prop_ro(
          "constant_bytes", [](const DeviceConstants& constants) { return constants.bytes(); },
          "Bytes of what stays.");

  m.def("launch_network_kernel", &launch_kernel, nb::arg("kernel"), nb::arg("blocks"),
        nb::arg("threads"), nb::arg("arguments"),
        "Run a kernel of EvSNet on the CPU, whose addresses are those of arrays: for tests.\n"
        "\n"
        "Args:\n"
        "    kernel: The name of a kernel of evsnet/gpu/network.cu.\n"
        "    blocks, threads: How many blocks are launched, and threads of each.\n"
        "    arguments: Arrays with the bytes of its arguments.");
}

}  // namespace evs
