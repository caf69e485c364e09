// The instruction set that the wide code of a translation unit is compiled for.
//
// Wide code is written once, in .inl files, and compiled once for each instruction set: the
// technique that Highway calls foreach_target. Each kernel_*.cpp is compiled with the flags of its
// own instruction set, defines the macros below and includes the code, which all lands in
// `namespace evs::EVS_NAMESPACE`.
//
//   EVS_VECTOR_BITS  bits of a register: 128, 256 or 512; 1024 for two registers of 512; 32 for one
//                    lane, which is scalar code
//   EVS_NAMESPACE    the namespace of this instruction set
//   EVS_INTRINSIC    the name of an intrinsic of x86 for registers of 128 or 256 bits
//   EVS_NEON         1: registers of 128 bits, with the instructions of NEON
//
// An .inl file is written as a header is: it has a guard, includes what it needs, and can be opened
// and compiled alone. Without macros it is the portable code.
//
// An .inl file includes no header of the standard library, and a header of its own only if that
// holds plain structures and functions that are always inlined: a template that was compiled with
// the flags of an instruction set could end up in code that runs on every machine.
#pragma once

#ifndef EVS_VECTOR_BITS
#define EVS_VECTOR_BITS 128
#define EVS_NAMESPACE portable
#define EVS_INTRINSIC(op) _mm_##op
#endif

#ifndef EVS_NEON
#define EVS_NEON 0
#endif

#if defined(__SSE2__)
#include <immintrin.h>
#elif EVS_NEON
#include <arm_neon.h>
#endif

// GCC's own AVX-512 headers set these off (PR 105593)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

// before functions that are called on a GPU, and inlined elsewhere: all of them, and those that
// only kernels of paths call there. With everything inlined they compile for a minute
#ifndef EVS_OUTLINE
#define EVS_OUTLINE
#endif
#ifndef EVS_OUTLINE_IN_PATHS
#define EVS_OUTLINE_IN_PATHS
#endif

#ifndef EVS_INLINE
#define EVS_INLINE [[gnu::always_inline]] inline
#endif
