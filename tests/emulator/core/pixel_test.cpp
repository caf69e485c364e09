// The event pixel with each of its terms alone and with all of them, on light of every kind: no
// term makes a reference infinite, and all instruction sets give the same bytes.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "sensor/pixel_array.h"
#include "tests/emulator/core/selftest.h"

namespace evs {
namespace {

constexpr int WIDTH = 37, HEIGHT = 11;
constexpr size_t PIXELS = static_cast<size_t>(WIDTH) * HEIGHT;
constexpr float NOT_A_NUMBER = std::numeric_limits<float>::quiet_NaN();

// The settings of a sensor and the memory of its fixed pattern.
struct Terms {
  PixelSettings settings;
  PixelPattern pattern;
  std::vector<float> theta, leak, rate;
  std::vector<uint8_t> hot;
  std::vector<uint32_t> periods;

  Terms() : theta(PIXELS, 0.2f), leak(PIXELS, 0x1p-30f), rate(PIXELS, 500.0f), hot(PIXELS, 1) {
    for (uint32_t i = 0; i < PIXELS; i++) periods.push_back(i % 7 == 0 ? 1u << 30 : 1 + 13 * i);
    theta[3] = std::numeric_limits<float>::infinity();  // a dead pixel
    leak[3] = 0.0f;
    rate[3] = 0.0f;
    settings.map = LogMap::linlog(255, 0.1f, 2.7182817f);
    settings.causes = true;
    pattern.theta_on = pattern.theta_off = theta.data();
  }
};

// Luminance that jumps, stands still, and is unusable; ticks of every length.
std::vector<Event> run(const Terms& terms, const std::string& isa, int threads,
                       PixelArrays arrays) {
  RunningMean& mean = arrays.running_mean;
  mean.noise_gain = mean.drift_gain = mean.least_gain = 0.1f;
  mean.noise_weight = 1.0f;
  PixelArray sensor(terms.settings, terms.pattern, WIDTH, HEIGHT, threads, isa);
  const float values[] = {0.5f,   0.0f,  1e9f,  -1.0f,  NOT_A_NUMBER,
                          1e-40f, -0.0f, 3e38f, 1e-19f, 0.5f};
  std::vector<float> light(PIXELS, 0.5f);
  std::vector<Event> found;
  int64_t t = 0;
  int round = 0;
  for (float value : values) {
    for (size_t i = 0; i < PIXELS / 2; i += 3) light[i] = value;
    for (uint32_t us : {1000u, 1000u, 1u, 50'000u, 1000u}) {
      if (++round % 11 == 0) us = 700'000;
      // so much photon noise fills a tick of any length with events
      if (terms.settings.photon.scale > 0.0) us = std::min(us, 5000u);
      size_t clamped = 0;
      // the rows of a frame are read, all in the first us of a short tick
      std::vector<RowRead> reads;
      for (int32_t row = 0; terms.settings.aps_crosstalk > 0.0 && row < HEIGHT; row++) {
        reads.push_back({row, 1 + row * static_cast<int32_t>(us) / HEIGHT});
      }
      const Tick tick{light.data(), t, us, {reads.data(), reads.size(), WIDTH}};
      EventBuffer events = sensor.step(arrays, tick, t, clamped);
      found.insert(found.end(), events.events.get(), events.events.get() + events.count);
      t += us;
    }
  }
  return found;
}

void survives(const Terms& terms) {
  const PixelMemory memory(terms.settings, terms.pattern, PIXELS);
  const PixelArrays& arrays = memory.arrays;
  const std::vector<Event> expected = run(terms, "portable", 1, arrays);
  check(!expected.empty(), "light makes events");
  bool finite = true;
  for (size_t i = 0; i < PIXELS; i++) finite = finite && !std::isinf(arrays.reference[i]);
  check(finite, "no light makes a reference infinite");
  bool sorted = true;
  for (size_t i = 1; i < expected.size(); i++) {
    sorted = sorted && expected[i].t >= expected[i - 1].t && expected[i].cause != 0;
  }
  check(sorted, "events are sorted and carry their cause");

  for (const std::string& isa : isa_available()) {
    const PixelMemory other(terms.settings, terms.pattern, PIXELS);
    const std::vector<Event> events = run(terms, isa, 2, other.arrays);
    check(events.size() == expected.size() &&
              std::memcmp(events.data(), expected.data(), events.size() * sizeof(Event)) == 0,
          "every instruction set gives the same events");
    check(other.bytes() == memory.bytes(), "every instruction set leaves the same state");
  }
}

}  // namespace

void pixels_survive_any_light() {
  const std::vector<std::function<void(Terms&)>> terms = {
      [](Terms& t) { t.settings.map = LogMap::log_eps(255, 0.0f, 1e-6f); },
      [](Terms& t) { t.settings.lowpass_low = 1e-5, t.settings.lowpass_slope = 1e-6; },
      [](Terms& t) { t.settings.follower = 1e-3; },
      [](Terms& t) { t.settings.follower = 1e-3, t.settings.euler = true; },
      // photon noise needs a dark current
      [](Terms& t) {
        t.settings.map = LogMap::physical(255, 0.1f);
        t.settings.follower = 1e-3, t.settings.photon = {7, 4e3};
      },
      [](Terms& t) {
        t.settings.map = LogMap::physical(255, 0.1f);
        t.settings.lowpass_low = 1e-5, t.settings.lowpass_slope = 1e-6;
        t.settings.photon = {7, 1e6};
      },
      [](Terms& t) { t.settings.highpass = 1e-6; },
      [](Terms& t) { t.settings.refractory = 300; },
      [](Terms& t) { t.settings.refractory = 60'000; },
      [](Terms& t) { t.settings.refractory = 1, t.pattern.refractory = t.periods.data(); },
      [](Terms& t) { t.pattern.leak = t.leak.data(), t.pattern.hot = t.hot.data(); },
      [](Terms& t) {
        t.pattern.leak = t.pattern.parasitic = t.leak.data();
        t.pattern.phase = t.leak.data();
        t.settings.parasitic_slope = 1e-7;
      },
      [](Terms& t) { t.settings.aps_crosstalk = 0.05; },
      [](Terms& t) { t.pattern.shot_on = t.pattern.shot_off = t.rate.data(); },
      [](Terms& t) {
        t.settings.noise_gain = t.settings.drift_gain = t.settings.least_gain = 0.1f;
        t.settings.running_mean = true;
      },
      [](Terms& t) { t.settings.map = LogMap::physical(255, 0.1f); },
      [](Terms& t) {
        t.settings.lowpass_low = 1e-5, t.settings.lowpass_slope = 1e-6;
        t.settings.euler = false, t.settings.large_signal = true;
      },
  };
  Terms all;
  survives(all);
  for (const auto& turn_on : terms) {
    Terms one;
    turn_on(one);
    survives(one);
    turn_on(all);
    survives(all);
  }
}

}  // namespace evs
