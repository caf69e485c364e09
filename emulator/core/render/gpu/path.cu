// The `path` integrator: a sample a thread, 8 x 4 pixels a warp. A second kernel adds up the
// samples of a pixel, in the order of the CPU.
#define EVS_BATCH_ROOM 1
#define EVS_OUTLINE_IN_PATHS __noinline__
#include "base/gpu/prelude.h"

#include "render/gpu/image_threads.cuh"
#include "render/integrators/wavefront.inl"

namespace evs {

// Trace samples `first` ... of every pixel, as many as the grid is deep. Out: light (3, samples, h,
// w).
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    trace_samples(const __grid_constant__ Frame frame, const __grid_constant__ PathFrame paths,
                  int first, float* light) {
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  PathBatch batch;
  cuda::Wavefront front = {batch, nullptr};
  int sample = first + static_cast<int>(blockIdx.z);
  cuda::start_paths(frame, paths, front, cuda::splat(x), cuda::splat(y), cuda::splat(sample),
                    nullptr, cuda::mask_from_bits(cuda::ALL_LANES));
  cuda::finish_paths(frame, paths, front);
  cuda::Float radiance[3];
  cuda::load_radiance(frame, batch, 0, radiance);
  long pixels = static_cast<long>(frame.width) * frame.height;
  long at = static_cast<long>(y) * frame.width + x;
  for (int c = 0; c < 3; c++) {
    light[(static_cast<long>(c) * gridDim.z + blockIdx.z) * pixels + at] = radiance[c].v;
  }
}

// Add samples `first` ... `first` + `count` - 1 of every pixel, as trace_packets does. In/out: sums
// (6, h, w). Out, behind the last sample: luminance (h, w).
extern "C" __global__ void __launch_bounds__(128)
    add_samples(const __grid_constant__ Frame frame, int first, int count, const float* light,
                float* sums, float* luminance) {
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  long pixels = static_cast<long>(frame.width) * frame.height;
  long at = static_cast<long>(y) * frame.width + x;
  cuda::Float mean[3];
  for (int c = 0; c < 3; c++) {
    float& sum_before = sums[c * pixels + at];
    float& part_before = sums[(3 + c) * pixels + at];
    float sum = first > 0 ? sum_before : 0.0f, part = first > 0 ? part_before : 0.0f;
    for (int k = 0; k < count; k++) {
      int s = first + k;
      part = part + light[(static_cast<long>(c) * count + k) * pixels + at];
      if (s % cuda::SUM_BLOCK != cuda::SUM_BLOCK - 1 && s != frame.samples - 1) continue;
      sum = sum + part;
      part = 0.0f;
    }
    sum_before = sum;
    part_before = part;
    mean[c] = cuda::splat(sum * (1.0f / static_cast<float>(frame.samples)));
  }
  if (first + count < frame.samples) return;
  luminance[at] = cuda::vignetted(frame, at, cuda::luminance_of<3>(frame, mean).v);
}

}  // namespace evs
