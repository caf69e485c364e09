// Durations of the row accesses of the arbiter. Each depends on the seed and the number of the
// access alone, so they are drawn in batches: one by one they would take half of the readout's
// time.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.h"
#include "normal.h"
#include "readout_state.h"

namespace evs {

struct ArbiterTimes {
  int64_t row_ns = 0;
  int64_t column_ns = 0;
  double jitter_ns = 0;  // standard deviation of the row access
};

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
    return ns_[number - first_];
  }

 private:
  static constexpr size_t kBatch = 64;
  using Draw = void (*)(const ArbiterTimes&, uint64_t key, uint64_t first, int64_t* out);

  EVS_ALWAYS_INLINE static void draw(const ArbiterTimes& times, uint64_t key, uint64_t first,
                                     int64_t* out) {
    const double row_ns = static_cast<double>(times.row_ns);
    const double jitter_ns = times.jitter_ns;
    for (size_t i = 0; i < kBatch; i++) {
      out[i] = round_ns(row_ns + jitter_ns * normal(key, (first + i) << 1));
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
