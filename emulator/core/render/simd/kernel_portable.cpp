// The kernel for every machine: 128-bit vectors, no intrinsics required.
#define EVS_WIDTH 128
#define EVS_SPACE portable
#define EVS_KERNEL KERNEL_PORTABLE
#define EVS_NATIVE(op) _mm_##op
#define EVS_PAIR(name) nullptr
#include "simd/kernel.inl"
