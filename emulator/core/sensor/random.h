// Counter-based random numbers: uniform, exponential and normal. They depend on (key, counter)
// alone, bit for bit as in emulator/sensor/random.py.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "base/reproducible_math.h"

namespace evs {

// The terms that draw random numbers are listed in emulator/sensor/random.py.
inline constexpr uint64_t TERM_SHOT = 6;

// 64 mixed bits: two rounds of SplitMix64 (Steele, Lea, Flood 2014).
EVS_ALWAYS_INLINE uint64_t hash(uint64_t key, uint64_t counter) {
  uint64_t mixed = key + counter * 0x9E3779B97F4A7C15ull;
  for (int i = 0; i < 2; i++) {
    mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9ull;
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EBull;
    mixed = mixed ^ (mixed >> 31);
  }
  return mixed;
}

// 53 of the bits as a number in [0, 1).
EVS_ALWAYS_INLINE double uniform(uint64_t bits) {
  return static_cast<double>(bits >> 11) * 0x1p-53;
}

// Natural logarithm by the series of artanh; error below 1e-15 for values in [2^-53, 1].
EVS_ALWAYS_INLINE double ln_double(double value) {
  constexpr double ROOT = 0.70710678118654757;  // sqrt(1 / 2) as a double
  const uint64_t bits = std::bit_cast<uint64_t>(value);
  const int exponent = static_cast<int>(bits >> 52) - 1022;
  // in [1/2, 1)
  const double mantissa =
      std::bit_cast<double>((bits & 0xfffffffffffffull) | 0x3fe0000000000000ull);
  const double z = (mantissa - ROOT) / (mantissa + ROOT);
  const double square = z * z;
  double series = 0.0;
  for (int odd = 21; odd > 0; odd -= 2) series = series * square + 1.0 / odd;
  return 2.0 * z * series + (exponent - 0.5) * 0.6931471805599453;
}

// An exponential random number of mean 1: the gap between events of a Poisson process of rate 1.
EVS_ALWAYS_INLINE double exponential(uint64_t bits) {
  const double log = ln_double(uniform(bits) + 0x1p-53);
  return log < 0.0 ? -log : 0.0;  // rounding may leave a log of 1e-17
}

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
