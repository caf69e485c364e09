// The GGX microfacet lobe of physical materials.
#pragma once

#include "simd/vec.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// pi times the GGX distribution of microfacet normals (Trowbridge & Reitz), for a unit half vector.
EVS_INLINE Float microfacet_distribution(Vec normal, Vec half_vector, Float alpha) {
  // use the sine itself: 1 - cosine^2 would cancel in a narrow lobe
  Vec sine = cross(normal, half_vector);
  Float cosine = dot(normal, half_vector), alpha2 = alpha * alpha;
  Float denominator = dot(sine, sine) + alpha2 * cosine * cosine;
  return alpha2 / (denominator * denominator);
}

// pi times the GGX BRDF for a reflectance of 1, times cos_in (Walter et al. 2007, with their
// separable Smith shadowing). In: unit vectors away from the surface, both on the normal's side. No
// divisor is less than alpha^2 times 1e-4.
EVS_INLINE Float ggx_lobe(Vec normal, Vec wo, Vec wi, Float alpha) {
  Float alpha2 = alpha * alpha, one_minus_alpha2 = 1.0f - alpha2;
  Float cos_in = max(dot(normal, wi), splat(0.0f)), cos_out = max(dot(normal, wo), splat(1e-4f));
  Float masking = (cos_in + sqrt(cos_in * cos_in * one_minus_alpha2 + alpha2)) *
                  (cos_out + sqrt(cos_out * cos_out * one_minus_alpha2 + alpha2));
  return microfacet_distribution(normal, normalize(wo + wi), alpha) / masking * cos_in;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
