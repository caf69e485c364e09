// Where a light can reach.
#pragma once

#include "scene.h"
#include "simd_target.h"

namespace evs {

// The cone and the range of a light.
struct LightReach {
  float cosine, sine;  // -1, 0: everywhere
  float fade;          // 1 / range^2; 0: everywhere

  EVS_INLINE bool bounded() const { return cosine > -1 || fade > 0; }
};

EVS_INLINE LightReach reach_of(const Light& light) {
  if (light.kind == IMAGE || light.kind == DIRECTIONAL) return {-1, 0, 0};
  float fade = light.fade > 0 ? light.fade : 0;
  if (light.kind != SPOT) return {-1, 0, fade};
  // 2e-6 covers the rounding of the cosine that is compared with cos_cutoff
  float cosine = light.cos_cutoff - 2e-6f;
  cosine = cosine > -1.0f ? cosine : -1.0f;
  float square = 1.0f - cosine * cosine;
  return {cosine, __builtin_sqrtf(square > 0 ? square : 0), fade};
}

}  // namespace evs
