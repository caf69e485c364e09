// A tick of event pixels on a device with memory of its own: a block of 64 pixels a thread, whose
// crossings go to memory of its own.
#pragma once

#include <algorithm>

#include "base/scan.h"
#include "sensor/pixel_block.h"

namespace evs {

// What a block of pixels would have needed, or did.
struct BlockCounts {
  uint32_t crossings;
  uint32_t candidates;  // of shot noise
  uint32_t clamped;     // pixels with unusable luminance
};

// The argument of the kernels.
struct DevicePixels {
  PixelStep step;
  uint64_t pixels;
  uint32_t crossing_room;     // of a block
  uint32_t candidate_room;    // of a block
  Crossing* crossings;        // Out: (blocks, crossing_room)
  ShotCandidate* candidates;  // scratch, (blocks, candidate_room)
  BlockCounts* counts;        // Out: (blocks,)
};

// What all blocks did, and the most that one of them needed.
struct TickCounts {
  uint32_t crossings;
  uint32_t most_crossings;
  uint32_t most_candidates;
  uint32_t clamped;

  EVS_ALWAYS_INLINE void operator+=(const TickCounts& more) {
    crossings += more.crossings;
    most_crossings = std::max(most_crossings, more.most_crossings);
    most_candidates = std::max(most_candidates, more.most_candidates);
    clamped += more.clamped;
  }
  EVS_ALWAYS_INLINE void operator+=(const BlockCounts& block) {
    *this += TickCounts{block.crossings, block.crossings, block.candidates, block.clamped};
  }
};

EVS_ALWAYS_INLINE size_t block_count(uint64_t pixels) {
  return static_cast<size_t>((pixels + BLOCK_PIXELS - 1) / BLOCK_PIXELS);
}

// Find where the crossings of each block go, by all threads of a scan. Out: offsets (blocks,).
EVS_ALWAYS_INLINE void place_crossings_of(const BlockCounts* counts, size_t blocks,
                                          uint32_t* offsets, ScanSums<TickCounts>& sums,
                                          TickCounts* all) {
  auto put = [&](size_t block, const TickCounts& before) { offsets[block] = before.crossings; };
  scan(counts, blocks, sums, put, all);
}

// Pack the crossings of a block among those of all, unless a block or all of them need more room.
// In: crossings (blocks, crossing_room). Out: packed (room,).
EVS_ALWAYS_INLINE void pack_crossings_of(size_t block, const BlockCounts* counts, size_t blocks,
                                         const Crossing* crossings, uint32_t crossing_room,
                                         const uint32_t* offsets, const TickCounts* all,
                                         uint32_t room, Crossing* packed) {
  if (block >= blocks) return;
  if (all->crossings > room || all->most_crossings > crossing_room) return;
  const Crossing* from = crossings + block * crossing_room;
  Crossing* to = packed + offsets[block];
  for (uint32_t i = 0; i < counts[block].crossings; i++) to[i] = from[i];
}

}  // namespace evs
