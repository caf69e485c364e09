// One build of the network's kernels. The includer defines EVS_WIDTH (bits), EVS_SPACE and
// EVS_KERNEL. As in light/kernel.inl, no template of the standard library may come out of here.

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "network_kernel.h"

// GCC's own AVX-512 headers set it off (PR 105593)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

#define EVS_INLINE [[gnu::always_inline]] inline

namespace evs {
namespace EVS_SPACE {
namespace {
#include "simd.inl"
#include "log_delta.inl"
#include "bilif.inl"
#include "convolution.inl"
#include "transpose.inl"
#include "layers.inl"
}  // namespace
}  // namespace EVS_SPACE

const NetworkKernel EVS_KERNEL = {EVS_SPACE::look, EVS_SPACE::to_x, EVS_SPACE::infer, EVS_SPACE::fire};

}  // namespace evs
