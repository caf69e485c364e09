// The kernels of EvSNet for AVX-512.
#define EVS_VECTOR_BITS 512
#define EVS_NAMESPACE network_avx512
#define EVS_KERNEL NETWORK_AVX512
#include "evsnet/network_kernel.inl"
