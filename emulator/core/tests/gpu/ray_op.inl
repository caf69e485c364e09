// The nearest hits of rays, and whether these lie in the shadow of a distant light.
#pragma once

#include "geometry/intersect.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int RAY_WORDS = 6;

// In: rays `i` and the next ones of (6, n): origin and direction. Out: (6, n): distance, geom,
// triangle, u, v, occluded.
EVS_INLINE void trace_rays(const Frame& f, const float* in, long n, long i, float* out) {
  auto get = [&](int k) { return load(in + k * n + i); };
  Rays rays = {{get(0), get(1), get(2)}, {get(3), get(4), get(5)}, false};
  Mask all = mask_from_bits(ALL_LANES);
  RayCone cone = ray_cone(rays.origin, rays.direction, all, T_INFINITY);
  Hit hit = intersect(f, rays, cone, all, splat(0.0f));
  Mask met = ~(hit.geom < splat(0));
  Vec point = rays.origin + rays.direction * (hit.distance * 0.999f);
  Vec light = normalize(splat(V3{0.4f, 0.8f, 0.3f}));
  Mask blocked = occluded(f, point, light, splat(T_INFINITY), hit.geom,
                          ray_cone(point, light, met, T_INFINITY), met, 0);
  const Float words[RAY_WORDS] = {hit.distance,
                                  to_float(hit.geom),
                                  to_float(hit.triangle),
                                  hit.u,
                                  hit.v,
                                  select(blocked, splat(1.0f), splat(0.0f))};
  for (int k = 0; k < RAY_WORDS; k++) store(out + k * n + i, words[k]);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
