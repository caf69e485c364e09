// Crosstalk of the intensity frames of a DAVIS into its event pixels: while a row of the frame is
// read, the signal of its pixels is higher for an instant. Those within `crosstalk` of their ON
// threshold fire, and their reference is reset to the signal of that microsecond, as after a noise
// event. The others are as before.
//
// A read is a candidate in the order of a pixel's events, after noise of the same microsecond.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sensor/shot_noise.h"

namespace evs {

// A row of a frame is read.
struct RowRead {
  int32_t row;
  int32_t offset;  // us after the start of the tick, in [1, tick]
};

// The row reads of a tick, by time.
struct RowReads {
  const RowRead* reads = nullptr;
  size_t count = 0;
  size_t width = 1;  // of the sensor, px
};

// What marks a candidate as a row read; the draws of noise are not negative.
inline constexpr double ROW_READ = -1.0;

// Add the reads of the pixels [first, first + count) to the candidates of their block, by time.
inline void add_row_reads(const RowReads& tick, size_t first, size_t count,
                          std::vector<ShotCandidate>& candidates) {
  const size_t noise = candidates.size();
  for (size_t k = 0; k < tick.count; k++) {
    const size_t row = static_cast<size_t>(tick.reads[k].row) * tick.width;
    const size_t end = std::min(first + count, row + tick.width);
    for (size_t pixel = std::max(first, row); pixel < end; pixel++) {
      candidates.push_back({static_cast<uint32_t>(pixel - first),
                            static_cast<uint32_t>(tick.reads[k].offset), ROW_READ});
    }
  }
  if (noise > 0 && candidates.size() > noise) {
    std::stable_sort(
        candidates.begin(), candidates.end(),
        [](const ShotCandidate& a, const ShotCandidate& b) { return a.offset < b.offset; });
  }
}

}  // namespace evs
