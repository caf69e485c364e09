// The `path` integrator: a sample a thread, whose light is summed in a second kernel, in the order
// of the CPU. On an H200 a fifth of the pixels were not those of the CPU, on which this source gives
// the right ones (docs/measured/gpu.md): not to be used before that is understood.
#define EVS_BATCH_ROOM 1
#include "prelude.h"

#include "integrators/wavefront.inl"

// of 128 threads, on a multiprocessor: more leave fewer registers to each
#ifndef BLOCKS
#define BLOCKS 1
#endif

namespace evs {

static_assert(sizeof(PathBatch) == 448, "measure.py reserves as many");

// The light of a sample: of pixel i % pixels, sample i / pixels. Out: (3, samples, pixels).
extern "C" __global__ void __launch_bounds__(128, BLOCKS)
    samples(const __grid_constant__ Frame frame, const __grid_constant__ PathFrame paths,
            PathBatch* batches, float* light) {
  long pixels = static_cast<long>(frame.width) * frame.height, all = pixels * frame.samples;
  long i = blockIdx.x * static_cast<long>(blockDim.x) + threadIdx.x;
  if (i >= all) return;
  int pixel = static_cast<int>(i % pixels), sample = static_cast<int>(i / pixels);
  PathBatch& batch = batches[i];
  cuda::Wavefront front = {batch, nullptr};
  cuda::start_paths(frame, paths, front, cuda::splat(pixel % frame.width),
                    cuda::splat(pixel / frame.width), cuda::splat(sample), nullptr,
                    cuda::mask_from_bits(cuda::ALL_LANES));
  cuda::finish_paths(frame, paths, front);
  cuda::Float radiance[3];
  cuda::load_radiance(frame, batch, 0, radiance);
  for (int c = 0; c < 3; c++) light[c * all + i] = radiance[c].v;
}

// The luminance of a pixel: sums as in trace_packets.
extern "C" __global__ void sum(const __grid_constant__ Frame frame, const float* light,
                               float* luminance) {
  long pixels = static_cast<long>(frame.width) * frame.height, all = pixels * frame.samples;
  long i = blockIdx.x * static_cast<long>(blockDim.x) + threadIdx.x;
  if (i >= pixels) return;
  cuda::Float mean[3];
  for (int c = 0; c < 3; c++) {
    float sum = 0, part = 0;
    for (int s = 0; s < frame.samples; s++) {
      part = part + light[c * all + s * pixels + i];
      if (s % cuda::SUM_BLOCK != cuda::SUM_BLOCK - 1 && s != frame.samples - 1) continue;
      sum = sum + part;
      part = 0;
    }
    mean[c] = cuda::splat(sum * (1.0f / static_cast<float>(frame.samples)));
  }
  luminance[i] = cuda::luminance_of<3>(frame, mean).v;
}

}  // namespace evs
