// The kernel for AVX-512.
#define EVS_WIDTH 512
#define EVS_SPACE avx512
#define EVS_KERNEL KERNEL_AVX512
#define EVS_TRACE_PAIR trace_pair_avx512
#define EVS_PATHS(name) name##_avx512
#include "kernel.inc"
