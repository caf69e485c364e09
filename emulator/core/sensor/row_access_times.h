// Durations of the row accesses of the arbiter. Each depends on the seed and the number of the
// access alone, so they are drawn in batches: one by one they would take half of the readout's
// time.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "base/isa.h"
#include "sensor/random.h"
#include "sensor/readout_state.h"

namespace evs {

struct ArbiterTimes {
  int64_t row_ns = 0;
  int64_t column_ns = 0;
  double jitter_ns = 0;  // standard deviation of the row access
  int64_t phase_ns = 0;  // at most 999
};

// A duration is a whole number of ns, so a normal number within kError settles nearly all. `normal`
// draws the others.
class RowAccessTimes {
 public:
  // Duration of access number `access`. In: key, from the seed and the term.
  int64_t duration_ns(const ArbiterTimes& times, uint64_t key, int64_t access) {
    if (!(times.jitter_ns > 0)) return times.row_ns;
    const uint64_t number = static_cast<uint64_t>(access);
    if (!drawn_ || key != key_ || number - first_ >= kBatch) {
      draw_(times, key, number, ns_);
      drawn_ = true;
      key_ = key;
      first_ = number;
    }
    int64_t& ns = ns_[number - first_];
    if (ns == kUnsettled) {
      ns = round_ns(static_cast<double>(times.row_ns) + times.jitter_ns * normal(key, number << 1));
    }
    return ns;
  }

 private:
  static constexpr size_t kBatch = 64;
  static constexpr int64_t kUnsettled = -1;
  // The normal numbers of `draw` are within 6e-8 of those of `normal`: an error of 8e-10 of the
  // logarithm is 5.7e-8 of its root at kLogNearest, beyond which it grows, and an error of 6.4e-9
  // of the cosine is 5.5e-8 of the largest number. The rounding of the
  // sum with row_ns is below 1e-14 of it.
  static constexpr double kError = 1e-7;
  static constexpr double kLogNearest = -1e-4;
  using Draw = void (*)(const ArbiterTimes&, uint64_t key, uint64_t first, int64_t* out);

  // ln_double with 5 terms of its series for 11: error below 8e-10.
  EVS_ALWAYS_INLINE static double ln_within(double value) {
    constexpr double kRoot = 0.70710678118654757;  // sqrt(1 / 2) as a double
    const uint64_t bits = std::bit_cast<uint64_t>(value);
    const int64_t exponent = static_cast<int64_t>(bits >> 52) - 1022;
    const double mantissa =
        std::bit_cast<double>((bits & 0xfffffffffffffull) | 0x3fe0000000000000ull);
    const double z = (mantissa - kRoot) / (mantissa + kRoot);
    const double square = z * z;
    double series = 0.0;
    for (int odd = 9; odd > 0; odd -= 2) series = series * square + 1.0 / odd;
    return 2.0 * z * series + (static_cast<double>(exponent) - 0.5) * 0.6931471805599453;
  }

  // cos_turn with 6 terms of its series for 9 and without divisions: error below 6.4e-9.
  EVS_ALWAYS_INLINE static double cos_turn_within(double turn) {
    const double half = std::fabs(turn - 0.5);
    const double folded = half < 0.5 - half ? half : 0.5 - half;
    const double angle = 6.283185307179586 * folded;
    const double square = angle * angle;
    // 1 / order! with the signs of the series
    double series = 1.0 / 479001600.0;
    series = series * square - 1.0 / 3628800.0;
    series = series * square + 1.0 / 40320.0;
    series = series * square - 1.0 / 720.0;
    series = series * square + 1.0 / 24.0;
    series = series * square - 0.5;
    return (half <= 0.25 ? -1.0 : 1.0) * (series * square + 1.0);
  }

  EVS_ALWAYS_INLINE static void draw(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    const double row_ns = static_cast<double>(times.row_ns);
    const double jitter_ns = times.jitter_ns;
    const double margin = kError * jitter_ns + 1e-14 * row_ns;
    for (size_t i = 0; i < kBatch; i++) {
      const uint64_t counter = (first + i) << 1;
      const double log = ln_within(uniform(hash(key, counter + 1)) + 0x1p-53);
      const double near = log < kLogNearest ? log : kLogNearest;
      const double turn = uniform(hash(key, counter + 2));
      const double ns = row_ns + jitter_ns * (std::sqrt(-2.0 * near) * cos_turn_within(turn)) + 0.5;
      // round_ns, if neither the error nor the logarithm may change the result
      const double whole = std::floor(ns);
      const double positive = whole > 0.0 ? whole : 0.0;
      const double rest = ns - whole;
      const double edge = rest < 1.0 - rest ? rest : 1.0 - rest;
      const double settled = edge > margin ? positive : static_cast<double>(kUnsettled);
      out[i] = static_cast<int64_t>(log < kLogNearest ? settled : static_cast<double>(kUnsettled));
    }
  }
  static void draw_portable(const ArbiterTimes& times, uint64_t key, uint64_t first, int64_t* out) {
    draw(times, key, first, out);
  }
#if EVS_X86
  EVS_AVX512 static void draw_avx512(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    draw(times, key, first, out);
  }
#endif

  static Draw choose() {
#if EVS_X86
    // AVX2 has neither 64-bit products nor their conversion, so it would be no faster
    if (isa_available().front() == "avx512") return draw_avx512;
#endif
    return draw_portable;
  }

  Draw draw_ = choose();
  bool drawn_ = false;
  uint64_t key_ = 0;
  uint64_t first_ = 0;
  int64_t ns_[kBatch];
};

}  // namespace evs
