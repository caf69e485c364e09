// A thread for each pixel of an image, 8 x 4 pixels a warp, in blocks of 128.
#pragma once

#include "scene.h"

// blocks on a multiprocessor: more leave fewer registers to each thread
#ifndef EVS_BLOCKS
#define EVS_BLOCKS 3
#endif

namespace evs {

// Find the pixel of a thread. Returns whether there is one.
EVS_INLINE bool pixel_of_thread(const Frame& frame, int& x, int& y) {
  x = static_cast<int>(blockIdx.x * 8 + threadIdx.x % 8);
  y = static_cast<int>(blockIdx.y * 16 + threadIdx.x / 8);
  return x < frame.width && y < frame.height;
}

}  // namespace evs
