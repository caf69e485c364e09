// The kernels of EvSNet for any machine. Where std::fma is a function call, they are about a
// hundred times slower.
#define EVS_VECTOR_BITS 128
#define EVS_NAMESPACE network_portable
#define EVS_KERNEL NETWORK_PORTABLE
#define EVS_INTRINSIC(op) _mm_##op
#include "evsnet/network_kernel.inl"
