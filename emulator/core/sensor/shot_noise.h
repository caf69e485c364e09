// Shot noise: events of a Poisson process whose rate depends on the light, at any instant of a
// tick.
//
// Thinning (Lewis and Shedler 1979): candidates come for a block of pixels at an upper bound of its
// rate. A candidate belongs to one pixel and is accepted with the ratio of that pixel's current
// rate to the bound. A tick without a candidate draws nothing, pixels have no state, and candidates
// do not depend on how time is divided into ticks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sensor/random.h"

namespace evs {

inline constexpr size_t BLOCK_PIXELS = 64;  // pixels that are stepped together

struct ShotNoise {
  uint64_t key = 0;     // from the seed and the term
  double bright = 1.0;  // rate in bright light over the rate in the dark
  // scale of the rate at a DN: linear, 1 - (1 - bright) min(1, offset + slope DN);
  // inverse, bright + (1 - bright) dim / (dim + DN)
  bool inverse = false;
  double slope = 0.0;   // 1 / DN
  double offset = 0.0;  // 1
  double dim_dn = 0.0;  // DN

  // Rate at this light over the rate in the dark; at most 1.
  double rate_scale(double dn) const {
    if (inverse) return bright + (1.0 - bright) * (dn > 0.0 ? dim_dn / (dim_dn + dn) : 1.0);
    return 1.0 - (1.0 - bright) * std::min(1.0, offset + slope * dn);
  }
};

// Of one block: time of its next candidate, in 2^-10 us of the sensor's clock, and candidates so
// far.
struct ShotClock {
  int64_t* next;
  int64_t* count;
};

inline constexpr int64_t SHOT_UNITS = 1024;  // in a us
inline constexpr int64_t NEVER = int64_t{1} << 62;

struct ShotCandidate {
  uint32_t pixel;   // in its block
  uint32_t offset;  // us after the start of the tick, in [1, tick]
  double draw_hz;   // uniform in [0, bound); accepted if below the rate of the pixel
};

// Highest rate of a pixel in the block, Hz. In: those of each pixel.
inline double shot_bound(const float* on, const float* off, size_t first, size_t count) {
  double bound = 0.0;
  for (size_t i = first; i < first + count; i++) {
    const double rate = static_cast<double>(on[i]) + static_cast<double>(off[i]);
    bound = std::max(bound, rate);
  }
  return bound;
}

// Append the candidates of a block in (begin_us, end_us] of the sensor's clock, in order, and
// advance its shot clock. Random number 2 n + 2 is candidate n (1, 2, ...): the high half gives its
// pixel, the low half its draw. Number 2 n + 1 is the gap after it, rounded up to whole 2^-10 us;
// number 1 is the gap before the first. Stamps round up.
inline void draw_candidates(const ShotNoise& shot, ShotClock clock, size_t block, size_t pixels,
                            double bound, int64_t begin_us, int64_t end_us,
                            std::vector<ShotCandidate>& out) {
  const uint64_t key = hash(shot.key, block + 1);
  const double mean_gap =
      1e6 * static_cast<double>(SHOT_UNITS) / (bound * static_cast<double>(pixels));
  while (*clock.next <= end_us * SHOT_UNITS) {
    const uint64_t number = static_cast<uint64_t>(*clock.count) * 2;
    if (number > 0) {  // the first time is the start of the clock, not a candidate
      const int64_t stamp = (*clock.next + SHOT_UNITS - 1) / SHOT_UNITS;
      const uint64_t bits = hash(key, number + 2);
      const uint64_t pixel = (bits >> 32) * pixels >> 32;
      const double draw = static_cast<double>(static_cast<uint32_t>(bits)) * 0x1p-32 * bound;
      out.push_back({static_cast<uint32_t>(pixel), static_cast<uint32_t>(stamp - begin_us), draw});
    }
    const double gap = std::ceil(exponential(hash(key, number + 1)) * mean_gap);
    // a block of dead pixels has an infinite gap
    *clock.next = gap < 0x1p61 ? *clock.next + static_cast<int64_t>(gap) : NEVER;
    *clock.count += 1;
  }
}

}  // namespace evs
