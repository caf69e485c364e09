// Gloss of physical materials: the GGX lobe.
#pragma once

#include "simd/vec.inl"

namespace evs::EVS_SPACE {
namespace {

// pi times the density of the facets that face `half` (Trowbridge & Reitz), a unit vector.
EVS_INLINE Float facets(Vec normal, Vec half, Float alpha) {
  // sine and cosine apart: 1 - cosine^2 would leave nothing of a narrow lobe
  Vec apart = cross(normal, half);
  Float cosine = dot(normal, half), square = alpha * alpha;
  Float spread = dot(apart, apart) + square * cosine * cosine;
  return square / (spread * spread);
}

// pi times the lobe's BRDF for a reflectance of 1, times the cosine of the light (Walter et al.
// 2007, with the separable shadowing of Smith that they use). In: unit vectors from the surface,
// both on the normal's side. Nothing here divides by less than alpha's square times 1e-4.
EVS_INLINE Float ggx(Vec normal, Vec view, Vec light, Float alpha) {
  Float square = alpha * alpha, rest = 1.0f - square;
  Float in = max(dot(normal, light), splat(0.0f)), out = max(dot(normal, view), splat(1e-4f));
  Float masking = (in + sqrt(in * in * rest + square)) * (out + sqrt(out * out * rest + square));
  return facets(normal, normalize(view + light), alpha) / masking * in;
}

}  // namespace
}  // namespace evs::EVS_SPACE
