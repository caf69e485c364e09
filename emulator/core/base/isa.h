// Instruction sets that are chosen at run time. These are target attributes, not compiler flags, so
// that no other inline function of the program is compiled to instructions that the machine lacks.
#pragma once

#include <string>
#include <vector>

#if defined(__x86_64__) && defined(__GNUC__)
#define EVS_X86 1
#define EVS_AVX2 __attribute__((target("avx2")))
#define EVS_AVX512 __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl")))
#endif

namespace evs {

// The instruction sets that this machine runs, best first: of "avx512", "avx2", "portable".
std::vector<std::string> isa_available();

}  // namespace evs
