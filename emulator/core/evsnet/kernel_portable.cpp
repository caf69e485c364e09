// The network's kernels for any machine. Where std::fma is a call, they are some hundred times
// slower.
#define EVS_WIDTH 128
#define EVS_SPACE network_portable
#define EVS_KERNEL NETWORK_PORTABLE
#define EVS_NATIVE(op) _mm_##op
#include "kernel.inl"
