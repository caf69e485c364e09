// Elementary functions that give the same bits for every compiler, machine and vector width. They
// use only + - * / sqrt and integer operations, so that loops over them vectorise, and no fma: the
// build turns contraction off. NumPy repeats every step (tests/support/reference/pixel is the
// oracle).
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#if defined(__GNUC__)
#define EVS_ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define EVS_ALWAYS_INLINE inline
#endif

// what a GPU calls, since inlined it would take long to compile
#ifdef EVS_ON_DEVICE
#define EVS_CALL_ON_DEVICE __noinline__
#else
#define EVS_CALL_ON_DEVICE
#endif

namespace evs {

// holds ? a : b without a branch, so that the compiler vectorises it.
EVS_ALWAYS_INLINE float select(bool holds, float a, float b) {
  const uint32_t mask = 0u - static_cast<uint32_t>(holds);
  return std::bit_cast<float>((std::bit_cast<uint32_t>(a) & mask) |
                              (std::bit_cast<uint32_t>(b) & ~mask));
}

EVS_ALWAYS_INLINE double select(bool holds, double a, double b) {
  const uint64_t mask = uint64_t{0} - static_cast<uint64_t>(holds);
  return std::bit_cast<double>((std::bit_cast<uint64_t>(a) & mask) |
                               (std::bit_cast<uint64_t>(b) & ~mask));
}

// sqrt(a^2 + b^2). A double holds the squares of all floats, so nothing overflows. std::hypot
// would ask for a libm that systems older than 2022 do not have.
EVS_ALWAYS_INLINE float hypotenuse(float a, float b) {
  return static_cast<float>(std::sqrt(static_cast<double>(a) * a + static_cast<double>(b) * b));
}

// Natural logarithm of a normal, positive, finite number. Error below 0.86 ulp; ln(1) = 0 exactly,
// and x <= y gives ln(x) <= ln(y) (checked for every such float and its successor). The result for
// zero, denormals, infinities and NaN is meaningless.
EVS_ALWAYS_INLINE float ln(float x) {
  // x = 2^exponent (1 + f), with 1 + f between sqrt(1/2) and sqrt(2); f is exact
  constexpr uint32_t SQRT_HALF = 0x3f3504f3u;
  const uint32_t bits = std::bit_cast<uint32_t>(x);
  const int32_t exponent = static_cast<int32_t>(bits - SQRT_HALF) >> 23;
  const uint32_t mantissa = bits - (static_cast<uint32_t>(exponent) << 23);
  const float f = std::bit_cast<float>(mantissa) - 1.0f;

  // ln(1 + f) = f - f^2 / 2 + f^3 p(f); p is a weighted minimax fit, error 0.05 * 2^-24 of ln
  float p = 0x1.1457aep-4f;
  p = p * f + -0x1.de3c22p-4f;
  p = p * f + 0x1.e6f06ep-4f;
  p = p * f + -0x1.fc2206p-4f;
  p = p * f + 0x1.233768p-3f;
  p = p * f + -0x1.555c4ep-3f;
  p = p * f + 0x1.99a4b6p-3f;
  p = p * f + -0x1.000006p-2f;
  p = p * f + 0x1.555548p-2f;
  const float square = f * f;
  const float tail = square * f * p - 0.5f * square;

  // exponent * ln 2 in two parts, the first exact; `rest` recovers the rounding of the first sum
  const float e = static_cast<float>(exponent);
  const float high = e * 0x1.62e4p-1f;
  const float low = e * 0x1.7f7d1cp-20f;
  const float sum = high + f;
  const float rest = f - (sum - high);
  return sum + (rest + (low + tail));
}

// 0 for values closer to 0 than `least`; a NaN stays.
EVS_ALWAYS_INLINE float flush_to_zero(float value, float least) {
  const float size = std::bit_cast<float>(std::bit_cast<uint32_t>(value) & 0x7fffffffu);
  return size < least ? 0.0f : value;
}

// e^-z for 0 <= z <= 80 in two parts: scale + scale * rest, where scale is a power of 2.
struct ExpParts {
  float scale;
  float rest;
};

EVS_ALWAYS_INLINE ExpParts exp_parts(float z) {
  // z = k ln 2 - r, |r| <= ln 2 / 2; k ln 2 in two parts, the first exact
  const int32_t k = static_cast<int32_t>(z * 0x1.715476p+0f + 0.5f);
  const float whole = static_cast<float>(k);
  const float r = (whole * 0x1.62e4p-1f - z) + whole * 0x1.7f7d1cp-20f;
  float p = 0x1.6c16c2p-10f;  // 1 / 6!, 1 / 5!, ...
  p = p * r + 0x1.111112p-7f;
  p = p * r + 0x1.555556p-5f;
  p = p * r + 0x1.555556p-3f;
  p = p * r + 0.5f;
  p = p * r + 1.0f;
  // e^r - 1 = p r and e^-z = 2^-k e^r
  return {std::bit_cast<float>((127 - k) << 23), p * r};
}

// 1 - e^-z; relative error below 1e-6. Nothing cancels close to zero, where the scale is 1.
EVS_ALWAYS_INLINE float one_minus_exp(ExpParts e) { return (1.0f - e.scale) - e.scale * e.rest; }
EVS_ALWAYS_INLINE float one_minus_exp(float z) { return one_minus_exp(exp_parts(z)); }

// e^-z; relative error below 1e-6.
EVS_ALWAYS_INLINE float exp_minus(ExpParts e) { return e.scale + e.scale * e.rest; }

}  // namespace evs
