// Counter-based normal random numbers, bit for bit those of emulator/sensor/random.py.
#pragma once

#include <cmath>
#include <cstdint>

#include "random.h"

namespace evs {

// The key of the random numbers of a term (Term in random.py).
inline uint64_t term_key(uint64_t seed, uint64_t term) { return hash(seed, term + 1); }

// cos(2 pi turn) for turn in [0, 1) by its Taylor series; error below 1e-12.
EVS_ALWAYS_INLINE double cos_turn(double turn) {
  const double half = std::fabs(turn - 0.5);
  const double folded = half < 0.5 - half ? half : 0.5 - half;
  const double angle = 6.283185307179586 * folded;
  const double square = angle * angle;
  double series = 0.0;
  for (int order = 18; order > 0; order -= 2) {
    series = (series + 1.0) * (-square / (order * (order - 1)));
  }
  return (half <= 0.25 ? -1.0 : 1.0) * (series + 1.0);
}

// A standard normal number from the counters `counter` + 1 and + 2 (Box and Muller 1958).
EVS_ALWAYS_INLINE double normal(uint64_t key, uint64_t counter) {
  const double log = ln_double(uniform(hash(key, counter + 1)) + 0x1p-53);
  const double radius = std::sqrt(-2.0 * (log < 0.0 ? log : 0.0));
  return radius * cos_turn(uniform(hash(key, counter + 2)));
}

}  // namespace evs
