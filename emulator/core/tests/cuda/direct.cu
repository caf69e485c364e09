// The `direct` integrator: a pixel a thread, 8 x 4 pixels a warp.
#include "prelude.h"

#include "integrators/direct.inl"

#ifndef CHANNELS
#define CHANNELS 1
#endif
// of 128 threads, on a multiprocessor: more leave fewer registers to each
#ifndef BLOCKS
#define BLOCKS 1
#endif

namespace evs {

extern "C" __global__ void __launch_bounds__(128, BLOCKS)
    direct(const __grid_constant__ Frame frame, float* luminance) {
  int x = static_cast<int>(blockIdx.x * 8 + threadIdx.x % 8);
  int y = static_cast<int>(blockIdx.y * 16 + threadIdx.x / 8);
  if (x >= frame.width || y >= frame.height) return;
  float* out = luminance + static_cast<long>(y) * frame.width + x;
  cuda::trace_scattered<CHANNELS>(frame, &x, &y, 1, out, nullptr);
}

}  // namespace evs
