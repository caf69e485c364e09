// The kernel for AVX2.
#define EVS_VECTOR_BITS 256
#define EVS_NAMESPACE avx2
#define EVS_KERNEL KERNEL_AVX2
#define EVS_INTRINSIC(op) _mm256_##op
#define EVS_PAIR(name) nullptr
#include "render/simd/kernel.inl"
