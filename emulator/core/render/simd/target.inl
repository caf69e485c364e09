// The instruction set that the wide code is compiled for, and its lanes.
//
// The tracer is written once, in `.inl` files, and compiled once for each instruction set: the
// technique that Highway calls foreach_target. Each kernel_*.cpp and *_pairs_*.cpp of this folder
// is compiled with the flags of its own instruction set, defines the macros below and includes the
// code, which all lands in `namespace evs::EVS_SPACE`.
//
// An `.inl` file is written as a header is: it has a guard, includes what it needs, and can be
// opened and compiled alone. No macro need be defined then: it is the portable code that one sees.
//
//   EVS_WIDTH    bits of a register: 128, 256, 512; 1024 for two of 512 (32 lanes in place of 16)
//   EVS_SPACE    the namespace of this instruction set
//   EVS_NATIVE   the name of an intrinsic for registers of 128 or 256 bits
//   EVS_KERNEL   kernel.inl: the name of the table of entry points
//   EVS_PAIR     kernel.inl: the name of an entry point that takes two packets at once, or nullptr
//   EVS_PATHS    kernel.inl: the name of an entry point of `path`, where they are compiled
//   elsewhere
//
// An `.inl` file includes no header of the standard library, and a header of its own only if that
// holds plain structures: a template that was compiled with these flags could end up in code that
// runs on every machine.
#pragma once

#ifndef EVS_WIDTH
#define EVS_WIDTH 128
#define EVS_SPACE portable
#define EVS_NATIVE(op) _mm_##op
#define EVS_KERNEL KERNEL_PORTABLE
#define EVS_PAIR(name) nullptr
#endif

#if defined(__SSE2__)
#include <immintrin.h>
#endif

// GCC's own AVX-512 headers set it off (PR 105593)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

#ifndef EVS_INLINE
#define EVS_INLINE [[gnu::always_inline]] inline
#endif

namespace evs::EVS_SPACE {
namespace {

// clang-format off: each file needs the one before it
#include "simd.h"
#include "quads.h"
#include "wide_math.h"
// clang-format on

}  // namespace
}  // namespace evs::EVS_SPACE
