// The name by which core/light includes quads.inl.
#pragma once

#include "quads.inl"
