// Instruction sets that are chosen at run time. These are target attributes, not compiler flags, so
// that no other inline function of the program is compiled to instructions that the machine lacks.
#pragma once

#include <string>
#include <vector>

#if defined(__x86_64__) && defined(__GNUC__)
#define EVS_X86 1
#define EVS_AVX2 __attribute__((target("avx2")))
#define EVS_AVX512 __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl")))
#else
#define EVS_X86 0
#endif
#if defined(__aarch64__)
#define EVS_ARM64 1
#else
#define EVS_ARM64 0
#endif

// Instruction sets in this build: all, or with EVS_ISA=native only the best of this machine. The
// kernels of one lane are for tests.
#ifndef EVS_BUILT_PORTABLE
#define EVS_BUILT_PORTABLE 1
#endif
#ifndef EVS_BUILT_NEON
#define EVS_BUILT_NEON EVS_ARM64
#endif
#ifndef EVS_BUILT_AVX2
#define EVS_BUILT_AVX2 EVS_X86
#endif
#ifndef EVS_BUILT_AVX512
#define EVS_BUILT_AVX512 EVS_X86
#endif
#ifndef EVS_BUILT_ONE_LANE
#define EVS_BUILT_ONE_LANE 0
#endif

namespace evs {

// The instruction sets that this machine runs and this build holds, the one that "auto" takes
// first: of "one_lane", "avx512", "avx2", "neon", "portable".
std::vector<std::string> isa_available();

}  // namespace evs
