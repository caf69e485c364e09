// The `direct` integrator: a pixel a thread, 8 x 4 pixels a warp. With adaptive antialiasing in two
// passes, as in antialiasing.h.
#include "base/gpu/prelude.h"

#include "render/gpu/image_threads.cuh"
#include "render/integrators/antialiasing_blend.h"

// channels of the frame
#ifndef EVS_CHANNELS
#define EVS_CHANNELS 1
#endif
// whether a launch renders many cameras
#ifndef EVS_MANY
#define EVS_MANY 0
#endif
// whether there are two passes
#ifndef EVS_ADAPTIVE
#define EVS_ADAPTIVE 0
#endif

namespace evs {

#if EVS_MANY

// All samples of every pixel of those of as many cameras as the grid is deep that have so many
// channels. In: rows of `stride` bytes which begin with a frame and end with where its light goes.
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    direct_of_many(const char* rows, unsigned stride) {
  const char* row = rows + static_cast<size_t>(blockIdx.z) * stride;
  const Frame& frame = *reinterpret_cast<const Frame*>(row);
  if (frame.channels != EVS_CHANNELS) return;
  float* luminance = *reinterpret_cast<float* const*>(row + stride - sizeof(float*));
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  float* out = luminance + static_cast<long>(y) * frame.width + x;
  cuda::trace_scattered<EVS_CHANNELS>(frame, &x, &y, 1, out, nullptr);
}

#elif !EVS_ADAPTIVE

// All samples of every pixel. Out: (h, w).
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    direct(const __grid_constant__ Frame frame, float* luminance) {
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  float* out = luminance + static_cast<long>(y) * frame.width + x;
  cuda::trace_scattered<EVS_CHANNELS>(frame, &x, &y, 1, out, nullptr);
}

#else

// One sample of every pixel. Out: (h, w) each.
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    first_pass(const __grid_constant__ Frame base, float* luminance, float* untextured) {
  int x, y;
  if (!pixel_of_thread(base, x, y)) return;
  long at = static_cast<long>(y) * base.width + x;
  cuda::trace_scattered<EVS_CHANNELS + 1>(base, &x, &y, 1, luminance + at, untextured + at);
}

// All samples of the pixels at an edge. In: untextured (h, w). In/out: luminance (h, w).
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    second_pass(const __grid_constant__ Frame frame, const float* untextured, float* luminance) {
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  float weight = weight_of_pixel(frame, x, y, untextured);
  if (!(weight > 0)) return;
  float& out = luminance[static_cast<long>(y) * frame.width + x];
  out = blend(out, cuda::refined_pixel<EVS_CHANNELS>(cuda::DirectShading{}, frame, x, y), weight);
}

#endif

}  // namespace evs
