// Events as dense arrays of one shape, as emulator/representations.py defines them: voxel grids,
// event frames, latest stamps, time surfaces, padded packets. The bytes are those of NumPy there.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "sensor/events.h"

namespace evs {

inline constexpr int64_t NO_EVENT = std::numeric_limits<int64_t>::min();  // no event yet

struct SensorSize {
  size_t width, height;
  size_t pixels() const { return width * height; }
  size_t pixel(const Event& event) const {
    return static_cast<size_t>(event.y) * width + static_cast<size_t>(event.x);
  }
};

// A voxel grid (bins, h, w) of the events between two times, each value within -limit ... limit.
// Sums are in double, first of all lower bins, then of all upper ones.
inline void fill_voxel_grid(const Event* events, size_t count, int64_t begin_us, int64_t end_us,
                            size_t bins, SensorSize size, float limit, std::vector<double>& sums,
                            float* out) {
  const size_t pixels = size.pixels();
  if (count == 0) {
    std::fill_n(out, bins * pixels, 0.0f);
    return;
  }
  sums.assign(bins * pixels, 0.0);
  const double span = static_cast<double>(std::max<int64_t>(end_us - begin_us, 1));
  const size_t last = bins > 2 ? bins - 2 : 0;
  auto add = [&](bool upper) {
    for (size_t i = 0; i < count; i++) {
      const double share = static_cast<double>(events[i].t - begin_us) / span;
      const double place = std::min(std::max(share, 0.0), 1.0) * static_cast<double>(bins - 1);
      const size_t lower = std::min(static_cast<size_t>(place), last);
      const double above = place - static_cast<double>(lower);
      const double sign = events[i].p != 0 ? 1.0 : -1.0;
      const size_t bin = upper ? std::min(lower + 1, bins - 1) : lower;
      sums[bin * pixels + size.pixel(events[i])] += upper ? sign * above : sign * (1.0 - above);
    }
  };
  add(false);
  add(true);
  for (size_t i = 0; i < bins * pixels; i++) {
    out[i] = std::min(std::max(static_cast<float>(sums[i]), -limit), limit);
  }
}

// How often each pixel fired (2, h, w), OFF then ON; 255 is that or more.
inline void fill_event_frame(const Event* events, size_t count, SensorSize size, uint8_t* out) {
  const size_t pixels = size.pixels();
  std::fill_n(out, 2 * pixels, uint8_t{0});
  for (size_t i = 0; i < count; i++) {
    uint8_t& fired = out[(events[i].p != 0 ? pixels : 0) + size.pixel(events[i])];
    fired = static_cast<uint8_t>(fired + (fired < 255));
  }
}

// When each pixel last fired (2, h, w), us; In/out.
inline void keep_latest(const Event* events, size_t count, SensorSize size, int64_t* stamps) {
  const size_t pixels = size.pixels();
  for (size_t i = 0; i < count; i++) {
    int64_t& stamp = stamps[(events[i].p != 0 ? pixels : 0) + size.pixel(events[i])];
    stamp = std::max(stamp, events[i].t);
  }
}

// e^x for x <= 0, in basic operations alone, so that every machine finds the same bits.
inline double decay(double x) {
  if (!(x > -104.0)) return 0.0;  // under half the smallest float
  const double k = std::floor(x * 1.4426950408889634 + 0.5);
  const double r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  // Taylor's series: |r| < 0.35
  double sum = 1.0 / 6227020800.0;
  const double factors[] = {1.0 / 479001600.0,
                            1.0 / 39916800.0,
                            1.0 / 3628800.0,
                            1.0 / 362880.0,
                            1.0 / 40320.0,
                            1.0 / 5040.0,
                            1.0 / 720.0,
                            1.0 / 120.0,
                            1.0 / 24.0,
                            1.0 / 6.0,
                            0.5,
                            1.0,
                            1.0};
  for (double factor : factors) sum = sum * r + factor;
  const uint64_t bits = static_cast<uint64_t>(static_cast<int64_t>(k) + 1023) << 52;
  double scale;
  std::memcpy(&scale, &bits, sizeof(scale));
  return sum * scale;
}

// e^(-(t_us - stamp) / tau_us) of each of `count` stamps; 0 where there never was an event.
inline void fill_time_surface(const int64_t* stamps, size_t count, double tau_us, int64_t t_us,
                              float* out) {
  for (size_t i = 0; i < count; i++) {
    if (stamps[i] == NO_EVENT) {
      out[i] = 0.0f;
      continue;
    }
    // a stamp after t_us is of now; the difference of others does not overflow
    const int64_t age_us = stamps[i] < t_us ? t_us - stamps[i] : 0;
    out[i] = static_cast<float>(decay(static_cast<double>(-age_us) / tau_us));
  }
}

// The last `capacity` events as rows (capacity, 4): us after t_us, x, y, polarity 1 or -1; zeros
// behind the last.
inline void fill_packet(const Event* events, size_t count, size_t capacity, int64_t t_us,
                        int32_t* out) {
  const size_t kept = std::min(count, capacity);
  const Event* event = events + (count - kept);
  const int64_t low = std::numeric_limits<int32_t>::min(),
                high = std::numeric_limits<int32_t>::max();
  for (size_t i = 0; i < kept; i++, event++, out += 4) {
    out[0] = static_cast<int32_t>(std::min(std::max(event->t - t_us, low), high));
    out[1] = event->x;
    out[2] = event->y;
    out[3] = event->p != 0 ? 1 : -1;
  }
  std::fill_n(out, 4 * (capacity - kept), 0);
}

}  // namespace evs
