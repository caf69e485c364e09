// The nearest hit and the occlusion of a ray a thread.
#include "prelude.h"

#include "ray_op.inl"

namespace evs {

extern "C" __global__ void __launch_bounds__(128)
    rays(const __grid_constant__ Frame frame, const float* in, long n, float* out) {
  long i = blockIdx.x * static_cast<long>(blockDim.x) + threadIdx.x;
  if (i < n) cuda::trace_rays(frame, in, n, i, out);
}

}  // namespace evs
