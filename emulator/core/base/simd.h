// The name by which core/light includes simd.inl.
#pragma once

#include "simd.inl"
