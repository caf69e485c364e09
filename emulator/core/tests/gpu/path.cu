// The `path` integrator: all samples of a pixel a thread, 8 x 4 pixels a warp, in a batch of its
// own. There are fewer batches than pixels: blocks go on to the next ones.
#define EVS_BATCH_ROOM 64
#include "prelude.h"

#include "integrators/wavefront.inl"

// of 128 threads, on a multiprocessor: more leave fewer registers to each
#ifndef BLOCKS
#define BLOCKS 1
#endif

namespace evs {

extern "C" __global__ void __launch_bounds__(128, BLOCKS)
    path(const __grid_constant__ Frame frame, const __grid_constant__ PathFrame paths,
         PathBatch* batches, float* luminance) {
  PathBatch& batch = batches[blockIdx.x * static_cast<long>(blockDim.x) + threadIdx.x];
  int columns = (frame.width + 7) / 8, tiles = columns * ((frame.height + 15) / 16);
  for (int tile = static_cast<int>(blockIdx.x); tile < tiles; tile += static_cast<int>(gridDim.x)) {
    int x = tile % columns * 8 + static_cast<int>(threadIdx.x % 8);
    int y = tile / columns * 16 + static_cast<int>(threadIdx.x / 8);
    if (x >= frame.width || y >= frame.height) continue;
    float* out = luminance + static_cast<long>(y) * frame.width + x;
    cuda::trace_path_pixels(frame, paths, batch, &x, &y, 1, out);
  }
}

// Bytes of a batch.
extern "C" __global__ void path_batch_bytes(unsigned long long* bytes) {
  *bytes = sizeof(PathBatch);
}

}  // namespace evs
