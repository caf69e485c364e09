// A fixed piece of work on one thread: what instructions are counted of, and whose bytes are
// compared between machines (.ci/neon.sh).
//
//   workload NAME ISA TICKS    prints a digest of all that the ticks gave out
//   workload                   prints the instruction sets of this machine

#include <bit>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "base/isa.h"
#include "evsnet/network_array.h"
#include "sensor/pixel_array.h"
#include "tests/emulator/core/selftest.h"

namespace evs {
namespace {

// FNV-1a of bytes
struct Digest {
  uint64_t value = 0xcbf29ce484222325u;

  void add(const void* bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
      value = (value ^ static_cast<const unsigned char*>(bytes)[i]) * 0x100000001b3u;
    }
  }
  template <class T>
  void add(const std::vector<T>& values) {
    add(values.data(), values.size() * sizeof(T));
  }
  void add(const EventBuffer& events) { add(events.events.get(), events.count * sizeof(Event)); }
};

// Numbers from -1 to 1 that need no library.
struct Numbers {
  uint32_t state = 1;

  float next() {
    state = state * 1664525u + 1013904223u;
    return static_cast<float>(static_cast<int32_t>(state) >> 8) * 0x1p-23f;
  }
  std::vector<float> next(size_t count, float scale) {
    std::vector<float> out(count);
    for (float& value : out) value = scale * next();
    return out;
  }
};

// A bright square that crosses a checkerboard.
void film(std::vector<float>& light, int width, int tick) {
  for (size_t i = 0; i < light.size(); i++) {
    const int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
    const bool square = (x + width - tick) % width < 16 && y % 32 < 16;
    light[i] = square ? 0.9f : (x / 8 + y / 8) % 2 == 0 ? 0.2f : 0.05f;
  }
}

// Every shape, light and texture, each geom moving. "absurd": from where they all but touch to
// where floats end.
void render(const std::string& name, const std::string& isa, int ticks, Digest& digest) {
  Tracing tracing;
  tracing.path = name == "path" || name == "absurd";
  tracing.hybrid = name == "hybrid";
  tracing.samples = name == "direct" ? 1 : 4;
  tracing.bounces = name == "direct" ? 0 : 3;
  const Optics optics = {64, 48, 60, 60, 32, 24};
  std::mt19937 random(5);
  const SceneData scene = scene_of_everything(0.5f);
  const double scales[] = {1e-6, 1e5, 1e12, 1e-30};
  Stage stage = stage_of(scene, random, 1);
  Caster caster(scene, optics, tracing, 1, isa);
  std::vector<float> light(64 * 48);
  for (int tick = 0; tick < ticks; tick++) {
    if (name == "absurd") stage = stage_of(scene, random, scales[tick % 4]);
    for (size_t i = 0; i < stage.geom_pos.size(); i += 3) stage.geom_pos[i] += 0.01;
    caster.render(stage.poses(), light.data(), nullptr);
    digest.add(light);
  }
}

// Event pixels as in the presets of chips: bandwidth, leak, refractory period and photon noise.
void pixels(const std::string& isa, int ticks, Digest& digest) {
  constexpr int WIDTH = 128, HEIGHT = 96;
  constexpr size_t PIXELS = static_cast<size_t>(WIDTH) * HEIGHT;
  const std::vector<float> theta(PIXELS, 0.2f), leak(PIXELS, 0x1p-26f);
  PixelSettings settings;
  settings.map = LogMap::physical(255, 0.1f);
  settings.lowpass_low = 1e-4, settings.lowpass_slope = 1e-4;
  settings.follower = 1e-2;
  settings.refractory = 300;
  settings.photon = {7, 1.3};
  PixelPattern pattern;
  pattern.theta_on = pattern.theta_off = theta.data();
  pattern.leak = leak.data();

  std::vector<float> light(PIXELS);
  const PixelMemory memory(settings, pattern, PIXELS);
  const PixelArrays& arrays = memory.arrays;
  PixelArray sensor(settings, pattern, WIDTH, HEIGHT, 1, isa);
  for (int tick = 0; tick < ticks; tick++) {
    film(light, WIDTH, tick);
    size_t clamped = 0;
    digest.add(sensor.step(arrays, {light.data(), 1000 * tick, 1000}, 1000 * tick, clamped));
  }
  digest.add(arrays.filtered, PIXELS * sizeof(float));
  digest.add(arrays.noise_budget, PIXELS * sizeof(double));
}

// EvSNet with 8 channels, every pixel in every tick.
void network(const std::string& isa, int ticks, Digest& digest) {
  constexpr int WIDTH = 32, HEIGHT = 16, TOGETHER = 16;
  constexpr size_t PIXELS = static_cast<size_t>(WIDTH) * HEIGHT, TILES = PIXELS / TILE_LANES;
  NetworkSettings settings;
  Network& net = settings.network;
  net.channels = 8;
  net.blocks = 3;
  Numbers numbers;
  const size_t biased = static_cast<size_t>(net.convolutions()) * 8;
  const std::vector<float> weights = numbers.next(net.weight_floats(), 0.3f);
  const std::vector<float> biases = numbers.next(biased, 0.05f), pointwise = numbers.next(8, 1.0f);
  const std::vector<int32_t> delays(3, 0);
  std::vector<float> low(DECAY_LOW, 1.0f), high(DECAY_HIGH, 0.0f);
  for (size_t i = 1; i < low.size(); i++) low[i] = low[i - 1] * 0.998f;
  high[0] = 1.0f, high[1] = 0.6f;
  net.weights = weights.data();
  net.biases = biases.data();
  net.delays = delays.data();
  net.pointwise = pointwise.data();
  settings.map = LogMap::linlog(255, 0.1f, 2.7182817f);
  settings.bilif = {1.0f, 1.0f, 1, low.data(), high.data()};
  settings.tick_us = 1000;
  settings.dense = true;

  std::vector<float> last_light(PIXELS, -1.0f), light(PIXELS);
  std::vector<float> last_log(PIXELS, std::numeric_limits<float>::quiet_NaN());
  std::vector<float> v(PIXELS), fifo, chunk_light;
  std::vector<int64_t> last(PIXELS), moved(PIXELS, -(int64_t{1} << 60));
  std::vector<int32_t> rows(TILES, -1);
  std::vector<uint8_t> loud(TILES);
  NetworkArrays arrays;
  arrays.last_luminance = last_light.data();
  arrays.last_log = last_log.data();
  arrays.v = v.data();
  arrays.last = last.data();
  arrays.tile_row = rows.data();
  arrays.tile_moved = moved.data();
  arrays.tile_loud = loud.data();
  NetworkArray array(settings, WIDTH, HEIGHT, 1, isa);
  NetworkCounts counts;
  auto grow = [&](size_t needed) {
    arrays.rows = needed;
    fifo.resize(needed * net.row_floats());
    return arrays.fifo = fifo.data();
  };
  for (int tick = 0; tick < ticks; tick += TOGETHER) {
    NetworkChunk chunk;
    chunk.ticks = std::min(TOGETHER, ticks - tick);
    chunk.tick = tick;
    chunk.begin_us = 1000 * tick;
    chunk_light.clear();
    for (int t = 0; t < chunk.ticks; t++) {
      film(light, WIDTH, tick + t);
      chunk_light.insert(chunk_light.end(), light.begin(), light.end());
    }
    chunk.luminance = chunk_light.data();
    for (const EventBuffer& events : array.step(arrays, chunk, grow, counts)) digest.add(events);
  }
  digest.add(v);
  digest.add(fifo);
}

}  // namespace
}  // namespace evs

int main(int count, char** words) {
  using namespace evs;
  if (count != 4) {
    for (const std::string& isa : isa_available()) std::printf("%s\n", isa.c_str());
    return count == 1 ? 0 : 2;
  }
  const std::string name = words[1], isa = words[2];
  const int ticks = std::atoi(words[3]);
  Digest digest;
  if (name == "pixels") {
    pixels(isa, ticks, digest);
  } else if (name == "network") {
    network(isa, ticks, digest);
  } else if (name == "direct" || name == "path" || name == "hybrid" || name == "absurd") {
    render(name, isa, ticks, digest);
  } else {
    std::fprintf(stderr, "no work '%s': direct, path, hybrid, absurd, pixels or network\n",
                 words[1]);
    return 2;
  }
  std::printf("%016llx\n", static_cast<unsigned long long>(digest.value));
  return 0;
}
