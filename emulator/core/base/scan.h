// Exclusive scan of counts by 1024 threads, in three steps between which all of them wait: those of
// a block of a GPU, or a thread after another on the CPU. Every thread has a part of the counts.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/reproducible_math.h"

namespace evs {

inline constexpr unsigned SCAN_THREADS = 1024;
inline constexpr unsigned SCAN_BLOCK = 32;  // threads whose sums are summed first

// What the threads share. Sum{} is the sum of nothing.
template <class Sum>
struct ScanSums {
  Sum of_thread[SCAN_THREADS];
  Sum of_block[SCAN_THREADS / SCAN_BLOCK];
};

// Run a step in every thread, and wait for all of them.
template <class Step>
EVS_ALWAYS_INLINE void for_scan_threads(const Step& step) {
#ifdef __CUDACC__
  step(threadIdx.x);
  __syncthreads();
#else
  for (unsigned thread = 0; thread < SCAN_THREADS; thread++) step(thread);
#endif
}

EVS_ALWAYS_INLINE void scan_part(unsigned thread, size_t count, size_t& first, size_t& end) {
  const size_t each = (count + SCAN_THREADS - 1) / SCAN_THREADS;
  first = thread * each < count ? thread * each : count;
  end = first + each < count ? first + each : count;
}

template <class Sum, class Count>
EVS_ALWAYS_INLINE void scan_sum_part(unsigned thread, const Count* counts, size_t count,
                                     ScanSums<Sum>& sums) {
  size_t first, end;
  scan_part(thread, count, first, end);
  Sum sum{};
  for (size_t i = first; i < end; i++) sum += counts[i];
  sums.of_thread[thread] = sum;
}

template <class Sum>
EVS_ALWAYS_INLINE void scan_sum_block(unsigned thread, ScanSums<Sum>& sums) {
  if (thread % SCAN_BLOCK != 0) return;
  Sum sum{};
  for (unsigned i = 0; i < SCAN_BLOCK; i++) sum += sums.of_thread[thread + i];
  sums.of_block[thread / SCAN_BLOCK] = sum;
}

template <class Sum, class Count, class Put>
EVS_ALWAYS_INLINE void scan_write(unsigned thread, const Count* counts, size_t count,
                                  const ScanSums<Sum>& sums, const Put& put, Sum* total) {
  Sum before{};
  for (unsigned i = 0; i < thread / SCAN_BLOCK; i++) before += sums.of_block[i];
  for (unsigned i = thread - thread % SCAN_BLOCK; i < thread; i++) before += sums.of_thread[i];
  size_t first, end;
  scan_part(thread, count, first, end);
  for (size_t i = first; i < end; i++) {
    const Count here = counts[i];
    put(i, before);
    before += here;
  }
  if (thread == SCAN_THREADS - 1) *total = before;
}

// Sum counts. Out: the sum of all; put(i, sum) takes the sum of those before each, and may write it
// in the place of that count.
template <class Sum, class Count, class Put>
EVS_ALWAYS_INLINE void scan(const Count* counts, size_t count, ScanSums<Sum>& sums, const Put& put,
                            Sum* total) {
  for_scan_threads([&](unsigned thread) { scan_sum_part(thread, counts, count, sums); });
  for_scan_threads([&](unsigned thread) { scan_sum_block(thread, sums); });
  for_scan_threads([&](unsigned thread) { scan_write(thread, counts, count, sums, put, total); });
}

}  // namespace evs
