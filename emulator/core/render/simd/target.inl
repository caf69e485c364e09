// The instruction set that the tracer's wide code is compiled for, and its lanes.
//
// base/simd_target.h explains the technique. Each kernel_*.cpp and *_pairs_*.cpp of this folder
// defines these macros too:
//
//   EVS_KERNEL   kernel.inl: the name of the table of entry points
//   EVS_PAIR     kernel.inl: the name of an entry point that takes two packets at once, or nullptr
//   EVS_PATHS    kernel.inl: the name of an entry point of `path`, where they are compiled
//   elsewhere
//
// EVS_WIDTH 1024 stands for two registers of 512 bits: 32 lanes in place of 16.
#pragma once

#ifndef EVS_WIDTH
#define EVS_KERNEL KERNEL_PORTABLE
#define EVS_PAIR(name) nullptr
#endif

#include "lanes.inl"
