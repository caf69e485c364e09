// The kernels of EvSNet for NEON.
#define EVS_VECTOR_BITS 128
#define EVS_NAMESPACE network_neon
#define EVS_KERNEL NETWORK_NEON
#define EVS_NEON 1
#include "evsnet/network_kernel.inl"
