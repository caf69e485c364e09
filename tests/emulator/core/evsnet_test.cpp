// EvSNet on light of every kind: tiles beyond the edge, chunks of any length, networks of every
// shape. All instruction sets, thread counts and chunks, sparse or dense, give the same bytes.

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "base/isa.h"
#include "base/scan.h"
#include "evsnet/device_constants.h"
#include "evsnet/network_array.h"
#include "tests/emulator/core/selftest.h"

namespace evs {
namespace {

constexpr float NOT_A_NUMBER = std::numeric_limits<float>::quiet_NaN();
constexpr int FRAMES = 150;

// A network and the memory of its parameters.
struct Filters {
  std::vector<float> weights, biases, pointwise, decay_low, decay_high;
  std::vector<int32_t> delays;
  NetworkSettings settings;

  Filters(int channels, int blocks, int delay, bool biased, float scale) {
    std::mt19937 random(static_cast<unsigned>(channels * 10 + blocks));
    std::normal_distribution<float> normal;
    Network& network = settings.network;
    network.channels = channels;
    network.blocks = blocks;
    const float deviation = scale / std::sqrt(3.5f * static_cast<float>(channels));
    for (size_t i = 0; i < network.weight_floats(); i++)
      weights.push_back(deviation * normal(random));
    for (int i = 0; i < network.convolutions() * channels; i++) {
      biases.push_back(biased ? 0.05f * normal(random) : 0.0f);
    }
    for (int i = 0; i < channels; i++) pointwise.push_back(normal(random));
    delays.assign(static_cast<size_t>(blocks), delay);
    for (int i = 0; i < DECAY_LOW; i++)
      decay_low.push_back(std::pow(0.998f, static_cast<float>(i)));
    for (int i = 0; i < DECAY_HIGH; i++) decay_high.push_back(i == 0 ? 1.0f : i == 1 ? 0.6f : 0.0f);
    network.weights = weights.data();
    network.biases = biases.data();
    network.delays = delays.data();
    network.pointwise = pointwise.data();
    settings.map = LogMap::linlog(255, 0.1f, 2.7182817f);
    settings.bilif = {1.0f, 1.25f, 1, decay_low.data(), decay_high.data()};
    settings.tick_us = 1000;
    settings.dense = biased;
  }
};

struct Size {
  int width, height;
  size_t pixels() const { return static_cast<size_t>(width) * static_cast<size_t>(height); }
  size_t tiles() const { return static_cast<size_t>((width + 3) / 4 * ((height + 3) / 4)); }
};

// Luminance that jumps, stands still, and is unusable.
std::vector<float> film(Size size) {
  std::mt19937 random(7);
  std::vector<float> light;
  std::vector<float> frame(size.pixels(), 0.5f);
  const float values[] = {0.5f,   0.0f,  1e9f,  -1.0f,  NOT_A_NUMBER,
                          1e-40f, -0.0f, 3e38f, 1e-19f, 0.7f};
  for (int k = 0; k < FRAMES; k++) {
    // stand still for longer than a tile keeps its row of memory
    if (k < 30 || k > 120) {
      for (float& pixel : frame) {
        if (random() % 8 == 0) pixel = values[random() % 10];
      }
    }
    light.insert(light.end(), frame.begin(), frame.end());
  }
  return light;
}

struct Result {
  std::vector<Event> events;
  std::vector<float> v, currents;
  std::vector<int64_t> last;
  std::vector<float> fifo;
  std::vector<int32_t> rows;
  NetworkCounts counts;

  bool same_stream(const Result& other) const {
    return events.size() == other.events.size() &&
           std::memcmp(events.data(), other.events.data(), events.size() * sizeof(Event)) == 0 &&
           std::memcmp(v.data(), other.v.data(), v.size() * sizeof(float)) == 0 &&
           std::memcmp(currents.data(), other.currents.data(), currents.size() * sizeof(float)) ==
               0 &&
           last == other.last && counts.clamped == other.counts.clamped &&
           counts.x_clamped == other.counts.x_clamped && counts.v_clamped == other.counts.v_clamped;
  }
  bool same_memory(const Result& other) const {
    return rows == other.rows && fifo.size() == other.fifo.size() &&
           std::memcmp(fifo.data(), other.fifo.data(), fifo.size() * sizeof(float)) == 0;
  }
};

Result run(const NetworkSettings& settings, Size size, const std::vector<float>& light,
           const std::string& isa, int threads, int cut) {
  NetworkArray array(settings, size.width, size.height, threads, isa);
  Result out;
  out.v.assign(size.pixels(), 0.3f);
  out.last.assign(size.pixels(), 0);
  out.rows.assign(size.tiles(), -1);
  out.currents.assign(light.size(), NOT_A_NUMBER);
  std::vector<float> last_luminance(size.pixels(), -1.0f), last_log(size.pixels(), NOT_A_NUMBER);
  std::vector<int64_t> moved(size.tiles() * TILE_LANES, -(int64_t{1} << 60));
  std::vector<uint8_t> loud(size.tiles(), 0);
  NetworkArrays arrays;
  arrays.last_luminance = last_luminance.data();
  arrays.last_log = last_log.data();
  arrays.v = out.v.data();
  arrays.last = out.last.data();
  arrays.tile_row = out.rows.data();
  arrays.tile_moved = moved.data();
  arrays.tile_loud = loud.data();
  size_t rows = 0;
  auto grow = [&](size_t needed) {
    rows = needed;
    out.fifo.resize(rows * settings.network.row_floats());
    return out.fifo.data();
  };
  for (int k = 0; k < FRAMES; k += cut) {
    arrays.fifo = out.fifo.data();
    arrays.rows = rows;
    NetworkChunk chunk;
    chunk.luminance = light.data() + static_cast<size_t>(k) * size.pixels();
    chunk.ticks = std::min(cut, FRAMES - k);
    chunk.tick = k;
    chunk.begin_us = 1000 * k;
    chunk.currents = out.currents.data() + static_cast<size_t>(k) * size.pixels();
    for (const EventBuffer& tick : array.step(arrays, chunk, grow, out.counts)) {
      out.events.insert(out.events.end(), tick.events.get(), tick.events.get() + tick.count);
    }
  }
  return out;
}

// The same by the kernels of a device, thread after thread, in arrays without room to spare.
Result run_on_device(const NetworkSettings& settings, Size size, const std::vector<float>& light) {
  const NetworkArray array(settings, size.width, size.height, 1, "portable");
  const DeviceConstants constants(array);
  std::vector<char> block(constants.bytes() + 256);
  char* aligned = block.data() + (256 - reinterpret_cast<uintptr_t>(block.data()) % 256) % 256;
  constants.copy(reinterpret_cast<uint64_t>(aligned), aligned);
  const size_t pixels = size.pixels(), groups = (pixels + TILE_GROUP - 1) / TILE_GROUP;
  Result out;
  out.v.assign(pixels, 0.3f);
  out.last.assign(pixels, 0);
  std::vector<float> last_luminance(pixels, -1.0f), last_log(pixels, NOT_A_NUMBER);
  std::vector<int64_t> moved(pixels, -(int64_t{1} << 60));
  std::vector<float> fifo(pixels * static_cast<size_t>(settings.network.fifo_floats()));
  std::vector<float> current(pixels), leaked(pixels);
  std::vector<uint16_t> marks(pixels);
  std::vector<uint32_t> counts(GROUP_COUNTS * groups), totals(GROUP_COUNTS);
  const DeviceNetwork network = constants.argument(
      reinterpret_cast<uint64_t>(aligned),
      {last_luminance.data(), last_log.data(), out.v.data(), out.last.data(), moved.data(),
       fifo.data(), current.data(), leaked.data(), marks.data(), counts.data(), totals.data()});
  const FlushDenormals flush;
  const size_t blocks = (pixels + 127) / 128;
  for (int64_t tick = 0; tick < FRAMES; tick++) {
    const float* frame = light.data() + static_cast<size_t>(tick) * pixels;
    run_network_kernel("step_pixels", blocks, 128, {&network, &tick, &frame});
    run_network_kernel("sum_groups", 1 + groups / 128, 128, {&network});
    run_network_kernel("scan_groups", GROUP_COUNTS, SCAN_THREADS, {&network});
    std::vector<std::vector<Crossing>> crossings(1, std::vector<Crossing>(totals[0]));
    Crossing* to = crossings[0].data();
    run_network_kernel("write_crossings", blocks, 128, {&network, &to});
    const EventBuffer events =
        order_events(crossings, 1000 * tick, 1000, static_cast<uint32_t>(size.width), false);
    out.events.insert(out.events.end(), events.events.get(), events.events.get() + events.count);
    out.currents.insert(out.currents.end(), current.begin(), current.end());
    out.counts.clamped += totals[1];
    out.counts.x_clamped += totals[2];
    out.counts.v_clamped += totals[3];
  }
  return out;
}

void survives(Filters filters, Size size, int most = 1) {
  filters.settings.bilif.most = most;
  const std::vector<float> light = film(size);
  const Result expected = run(filters.settings, size, light, "portable", 1, 1);
  check(!expected.events.empty(), "moving light makes a network fire");
  check(expected.counts.clamped > 0, "unusable luminance is counted");
  bool finite = true, sorted = true;
  for (float v : expected.v) finite = finite && std::abs(v) <= LARGEST_V;
  for (float value : expected.fifo) finite = finite && std::isfinite(value);
  check(finite, "no light makes a membrane or a FIFO infinite");
  for (size_t i = 1; i < expected.events.size(); i++) {
    sorted = sorted && expected.events[i].t >= expected.events[i - 1].t;
  }
  check(sorted, "the network's events are sorted");

  for (const std::string& isa : isa_available()) {
    for (int cut : {1, 7, 16, TICK_CHUNK}) {
      const Result found = run(filters.settings, size, light, isa, cut % 3 + 1, cut);
      check(found.same_stream(expected), "every instruction set and cut gives the same stream");
      check(found.same_memory(expected), "every instruction set and cut leaves the same memory");
    }
  }
  check(run_on_device(filters.settings, size, light).same_stream(expected),
        "a device's kernels give the same stream");
  NetworkSettings dense = filters.settings;
  dense.dense = true;
  check(run(dense, size, light, "auto", 2, 13).same_stream(expected), "sparse is dense");
}

void damage_is_refused() {
  for (int32_t row : {-2, 3, 5, 2000000000}) {
    FifoRows rows;
    std::vector<int32_t> tiles(6, -1);
    tiles[0] = 3;
    tiles[4] = row;
    bool refused = false;
    try {
      rows.begin(tiles.data(), tiles.size(), 5);
    } catch (const std::invalid_argument&) {
      refused = true;
    }
    check(refused, "a row that does not exist, or that two tiles share, is refused");
  }
}

}  // namespace

void networks_survive_any_light() {
  for (Size size : {Size{13, 6}, {1, 1}, {4, 4}, {35, 3}}) {
    survives(Filters(4, 1, 0, false, 1.0f), size);
  }
  const Size size{18, 7};
  survives(Filters(8, 3, 0, false, 1.0f), size);
  survives(Filters(8, 2, 6, true, 1.0f), size);
  survives(Filters(3, 2, 5, false, 1.0f), size);
  survives(Filters(1, 3, 1, true, 1.0f), size);
  survives(Filters(9, 0, 0, false, 1.0f), size);
  survives(Filters(4, 3, 2, false, 1e12f), size);  // sums overflow
  for (int most : {3, MOST_SPIKES}) {
    survives(Filters(4, 1, 0, false, 1.0f), {13, 6}, most);
    survives(Filters(4, 3, 2, false, 1e12f), size, most);
    survives(Filters(3, 2, 5, true, 1.0f), size, most);
  }
  damage_is_refused();
}

}  // namespace evs
