// A tick of event pixels on a device with memory of its own: a block of 64 pixels a thread, whose
// crossings go to memory of its own.
#pragma once

#include "pixel_block.h"

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
};

EVS_ALWAYS_INLINE size_t block_count(uint64_t pixels) {
  return static_cast<size_t>((pixels + kBlock - 1) / kBlock);
}

}  // namespace evs
