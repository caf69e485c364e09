// The kernel for every machine: 128-bit vectors, no intrinsics required.
#define EVS_VECTOR_BITS 128
#define EVS_NAMESPACE portable
#define EVS_KERNEL KERNEL_PORTABLE
#define EVS_INTRINSIC(op) _mm_##op
#define EVS_PAIR(name) nullptr
#include "render/simd/kernel.inl"
