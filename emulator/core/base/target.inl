// The lanes of this instruction set, and functions of them, in its namespace (simd_target.h).
#pragma once

#include "simd_target.h"

namespace evs::EVS_SPACE {
namespace {

// these three name no namespace, so that they are included in that of the target
#include "quads.inl"
#include "simd.inl"
#include "wide_math.inl"

}  // namespace
}  // namespace evs::EVS_SPACE
