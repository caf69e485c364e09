// The name by which core/light includes wide_math.inl.
#pragma once

#include "wide_math.inl"
