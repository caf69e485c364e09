// The kernels of EvSNet of one lane, for tests (EVS_ISA=one_lane).
#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE network_one_lane
#define EVS_KERNEL NETWORK_ONE_LANE
#include "evsnet/network_kernel.inl"
