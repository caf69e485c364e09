// The kernels of EvSNet for AVX-512.
#define EVS_WIDTH 512
#define EVS_SPACE network_avx512
#define EVS_KERNEL NETWORK_AVX512
#include "kernel.inl"
