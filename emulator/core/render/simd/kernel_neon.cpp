// The kernel for NEON, which every 64-bit ARM processor has.
#define EVS_VECTOR_BITS 128
#define EVS_NAMESPACE neon
#define EVS_KERNEL KERNEL_NEON
#define EVS_NEON 1
#define EVS_PAIR(name) nullptr
#include "render/simd/kernel.inl"
