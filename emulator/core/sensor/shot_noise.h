// Shot noise: events as a Poisson process whose rate follows the light, at any instant of a tick.
//
// By thinning (Lewis and Shedler 1979): each block of pixels has candidates at the highest rate its
// pixels could have all together, and a candidate becomes an event of one of them with the share
// that this pixel's rate has now. Nothing is drawn in a tick without a candidate, no pixel keeps
// anything, and how time is cut into ticks changes no candidate.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "random.h"

namespace evs {

inline constexpr size_t kBlock = 64;  // pixels that are stepped together

struct ShotNoise {
  const float* on = nullptr;   // Hz, of each pixel in the dark; null: no shot noise
  const float* off = nullptr;  // Hz
  uint64_t key = 0;            // of the seed and the term
  double bright = 1.0;         // share of the rate left in bright light
  // of the illuminance E: linear, 1 - (1 - bright) min(1, offset + slope E) per DN;
  // inverse, bright + (1 - bright) dim / (dim + E)
  bool inverse = false;
  double slope = 0.0;   // 1 / DN
  double offset = 0.0;  // 1
  double dim_dn = 0.0;  // DN

  // Share of the rate in the dark that is left at this light; at most 1.
  double share(double dn) const {
    if (inverse) return bright + (1.0 - bright) * (dn > 0.0 ? dim_dn / (dim_dn + dn) : 1.0);
    return 1.0 - (1.0 - bright) * std::min(1.0, offset + slope * dn);
  }
};

// Of one block: when its next candidate comes, and how many came. Time counts in 2^-10 us of the
// sensor's clock.
struct ShotClock {
  int64_t* next;
  int64_t* count;
};

inline constexpr int64_t kShotUnits = 1024;  // in a us
inline constexpr int64_t kNever = int64_t{1} << 62;

// A candidate: where and when it comes, and the number in [0, bound) that decides about it.
struct ShotCandidate {
  uint32_t pixel;   // in its block
  uint32_t offset;  // us after the start of the tick, in [1, tick]
  double lot;       // Hz
};

// The highest rate of one pixel of a block, Hz.
inline double shot_bound(const ShotNoise& shot, size_t first, size_t count) {
  double bound = 0.0;
  for (size_t i = first; i < first + count; i++) {
    const double rate = static_cast<double>(shot.on[i]) + static_cast<double>(shot.off[i]);
    bound = std::max(bound, rate);
  }
  return bound;
}

// Candidates of a block in (begin_us, end_us] of the sensor's clock, in order; the clock goes on.
// Candidate n (1, 2, ...) has the number 2 n + 2: its high half is the pixel, the low one the lot.
// Number 2 n + 1 is the gap after it, in whole 2^-10 us, rounded up, and 1 the one before the
// first. Stamps round up.
inline void draw_candidates(const ShotNoise& shot, ShotClock clock, size_t block, size_t pixels,
                            double bound, int64_t begin_us, int64_t end_us,
                            std::vector<ShotCandidate>& out) {
  const uint64_t key = hash(shot.key, block + 1);
  const double mean_gap =
      1e6 * static_cast<double>(kShotUnits) / (bound * static_cast<double>(pixels));
  while (*clock.next <= end_us * kShotUnits) {
    const uint64_t number = static_cast<uint64_t>(*clock.count) * 2;
    if (number > 0) {  // the first is where the clock starts, no candidate
      const int64_t stamp = (*clock.next + kShotUnits - 1) / kShotUnits;
      const uint64_t bits = hash(key, number + 2);
      const uint64_t place = (bits >> 32) * pixels >> 32;
      const double lot = static_cast<double>(static_cast<uint32_t>(bits)) * 0x1p-32 * bound;
      out.push_back({static_cast<uint32_t>(place), static_cast<uint32_t>(stamp - begin_us), lot});
    }
    const double gap = std::ceil(exponential(hash(key, number + 1)) * mean_gap);
    // a block of dead pixels has a gap without end
    *clock.next = gap < 0x1p61 ? *clock.next + static_cast<int64_t>(gap) : kNever;
    *clock.count += 1;
  }
}

}  // namespace evs
