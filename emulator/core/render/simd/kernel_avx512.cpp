// The kernel for AVX-512.
#define EVS_VECTOR_BITS 512
#define EVS_NAMESPACE avx512
#define EVS_KERNEL KERNEL_AVX512
#define EVS_PAIR(name) name##_pair_avx512
#define EVS_PATHS(name) name##_avx512
#include "render/simd/kernel.inl"

namespace evs {

void find_geoms_avx512(const GeomBvh& bvh, const RayCone& cone, GeomSet& found) {
  avx512::find_geoms(bvh, cone, found);
}

}  // namespace evs
