// The kernel for AVX2.
#define EVS_WIDTH 256
#define EVS_SPACE avx2
#define EVS_KERNEL KERNEL_AVX2
#define EVS_NATIVE(op) _mm256_##op
#define EVS_PAIR(name) nullptr
#include "simd/kernel.inl"
