// The kernels of EvSNet for AVX2 with FMA.
#define EVS_VECTOR_BITS 256
#define EVS_NAMESPACE network_avx2
#define EVS_KERNEL NETWORK_AVX2
#define EVS_INTRINSIC(op) _mm256_##op
#include "evsnet/network_kernel.inl"
