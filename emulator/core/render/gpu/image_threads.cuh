// A thread for each pixel of an image, 8 x 4 pixels a warp, in blocks of 128.
#pragma once

#include "render/integrators/antialiasing.inl"
#include "scene/scene.h"

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

// How much all samples of a pixel count, as in antialiasing.inl. In:
// untextured (h, w).
EVS_INLINE float weight_of_pixel(const Frame& frame, int x, int y, const float* untextured) {
  const float* neighbours[9];
  for (int i = 0; i < 9; i++) {
    // clamp to the image
    int column = x + i % 3 - 1, row = y + i / 3 - 1;
    column = column < 0 ? 0 : column >= frame.width ? frame.width - 1 : column;
    row = row < 0 ? 0 : row >= frame.height ? frame.height - 1 : row;
    neighbours[i] = untextured + static_cast<long>(row) * frame.width + column;
  }
  float weight;
  cuda::refinement_weight(neighbours, &weight);
  return weight;
}

}  // namespace evs
