// Exclusive scan of counts by 1024 threads of a GPU, in three steps between which all of them wait.
// Every thread has a part of the counts, one after another.
#pragma once

#include <cstddef>
#include <cstdint>

#include "reproducible_math.h"

namespace evs {

inline constexpr unsigned kScanThreads = 1024;
inline constexpr unsigned kScanBlock = 32;  // threads whose sums are summed first

// What the threads share.
struct ScanSums {
  uint32_t of_thread[kScanThreads];
  uint32_t of_block[kScanThreads / kScanBlock];
};

EVS_ALWAYS_INLINE void scan_part(unsigned thread, size_t count, size_t& first, size_t& end) {
  const size_t each = (count + kScanThreads - 1) / kScanThreads;
  first = thread * each < count ? thread * each : count;
  end = first + each < count ? first + each : count;
}

EVS_ALWAYS_INLINE void scan_sum_part(unsigned thread, const uint32_t* counts, size_t count,
                                     ScanSums& sums) {
  size_t first, end;
  scan_part(thread, count, first, end);
  uint32_t sum = 0;
  for (size_t i = first; i < end; i++) sum += counts[i];
  sums.of_thread[thread] = sum;
}

EVS_ALWAYS_INLINE void scan_sum_block(unsigned thread, ScanSums& sums) {
  if (thread % kScanBlock != 0) return;
  uint32_t sum = 0;
  for (unsigned i = 0; i < kScanBlock; i++) sum += sums.of_thread[thread + i];
  sums.of_block[thread / kScanBlock] = sum;
}

// In/out: counts; each becomes the sum of those before it. Out: the sum of all.
EVS_ALWAYS_INLINE void scan_write(unsigned thread, uint32_t* counts, size_t count,
                                  const ScanSums& sums, uint32_t* total) {
  uint32_t before = 0;
  for (unsigned i = 0; i < thread / kScanBlock; i++) before += sums.of_block[i];
  for (unsigned i = thread - thread % kScanBlock; i < thread; i++) before += sums.of_thread[i];
  size_t first, end;
  scan_part(thread, count, first, end);
  for (size_t i = first; i < end; i++) {
    const uint32_t here = counts[i];
    counts[i] = before;
    before += here;
  }
  if (thread == kScanThreads - 1) *total = before;
}

}  // namespace evs
