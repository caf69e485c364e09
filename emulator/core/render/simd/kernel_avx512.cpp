// The kernel for AVX-512.
#define EVS_WIDTH 512
#define EVS_SPACE avx512
#define EVS_KERNEL KERNEL_AVX512
#define EVS_PAIR(name) name##_pair_avx512
#define EVS_PATHS(name) name##_avx512
#include "simd/kernel.inl"
