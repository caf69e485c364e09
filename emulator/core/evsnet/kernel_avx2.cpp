// The kernels of EvSNet for AVX2 with FMA.
#define EVS_WIDTH 256
#define EVS_SPACE network_avx2
#define EVS_KERNEL NETWORK_AVX2
#define EVS_NATIVE(op) _mm256_##op
#include "kernel.inl"
