// Counter-based random numbers: 64 bits that depend on (key, counter) alone, bit for bit those of
// emulator/sensor/random.py.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "reproducible_math.h"

namespace evs {

// The terms that draw random numbers are listed in emulator/sensor/random.py.
inline constexpr uint64_t kTermShot = 6;

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
  constexpr double kRoot = 0.70710678118654757;  // sqrt(1 / 2) as a double
  const uint64_t bits = std::bit_cast<uint64_t>(value);
  const int exponent = static_cast<int>(bits >> 52) - 1022;
  // in [1/2, 1)
  const double mantissa =
      std::bit_cast<double>((bits & 0xfffffffffffffull) | 0x3fe0000000000000ull);
  const double z = (mantissa - kRoot) / (mantissa + kRoot);
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

}  // namespace evs
