// Instruction sets that are chosen at run time. Target attributes, not compiler flags: no other
// inline function of the program may come out with instructions that the machine lacks.
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

// Instruction sets whose kernels this build holds: all, unless CMake was asked for this machine's
// best only (EVS_ISA=native).
#ifndef EVS_BUILT_PORTABLE
#define EVS_BUILT_PORTABLE 1
#endif
#ifndef EVS_BUILT_AVX2
#define EVS_BUILT_AVX2 EVS_X86
#endif
#ifndef EVS_BUILT_AVX512
#define EVS_BUILT_AVX512 EVS_X86
#endif

namespace evs {

// Instruction sets that this machine runs and this build holds, the best first (dispatch.cpp).
std::vector<std::string> isa_available();

}  // namespace evs
