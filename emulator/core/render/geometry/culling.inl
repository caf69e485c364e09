// What need not be looked for: no shadow and, in `direct`, no image in a mirror where nothing is
// near; no light from a lamp that is far.
#pragma once

#include "geometry/ray_cone.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

// Can a ray of `active` come near the ball? With the slack of `any_near`.
EVS_INLINE bool any_towards(const Ball& ball, Vec origin, Vec direction, Mask active) {
  if (ball.radius < 0) return false;
  Vec v = splat(ball.center) - origin;
  Float along = dot(v, direction);
  Vec across = v - direction * along;
  Float reach = abs(along) * 2e-6f + ball.radius * 1.000002f;
  return any(active & (along >= -reach) & (dot(across, across) <= reach * reach));
}

struct Balls {
  Vec center;
  Float radius;
};

// Balls in which the light's strength may be more than 0: not those outside its cone or its range.
// What is not finite is in reach.
EVS_INLINE Mask in_reach(const Light& light, const Balls& balls) {
  Mask outside = mask_of(0);
  bool spot = light.kind == SPOT, ends = light.kind != DIRECTIONAL && light.fade > 0;
  if (light.kind == IMAGE || !(spot || ends)) return ~outside;
  Vec w = balls.center - splat(light.position);
  Float away = sqrt(dot(w, w));
  V3 p = light.position;
  float place = __builtin_fabsf(p.x) + __builtin_fabsf(p.y) + __builtin_fabsf(p.z);
  // the rounding of places, and of directions over the distance
  Float slack = balls.radius * 1.00001f + (away * 1e-5f + place * 1e-6f);
  if (spot) {
    // 2e-6: the rounding of the cosine that is compared with cos_cutoff
    float cosine = light.cos_cutoff - 2e-6f;
    cosine = cosine > -1.0f ? cosine : -1.0f;
    float square = 1.0f - cosine * cosine, sine = __builtin_sqrtf(square > 0 ? square : 0);
    Float along = dot(w, splat(light.direction));
    Vec off = w - splat(light.direction) * along;
    // how far the center lies outside the cone's side
    outside = sqrt(dot(off, off)) * cosine - along * sine > slack;
  }
  if (ends) {
    Float nearest = away - slack;
    outside = outside | ((nearest > 0.0f) & (nearest * nearest * light.fade > 1.0001f));
  }
  return ~outside;
}

// Can a plane be in the way of a light that `idle` of them never bar?
EVS_INLINE bool barred_by_planes(const Frame& f, uint32_t idle) {
  uint32_t planes = f.plane_count < 32 ? (1u << f.plane_count) - 1 : ~0u;
  return f.plane_count > 32 || (planes & ~idle);
}

// The points of a patch, once somebody asks where they are.
struct Points {
  Region region;
  bool known = false;

  template <class Interaction>
  const Region& of(const Interaction& patch, Mask lit) {
    if (!known) region = region_of(patch.origin, patch.step, lit);
    known = true;
    return region;
  }
};

// Do camera rays that hit the only plane, which is flat, see nothing in it? What they see there is
// what they would run into behind it. A ray that grazes it is left to the trace.
EVS_INLINE bool mirrors_nothing(const Frame& f, const Rays& rays, const Hit& hit, Mask mirror) {
  if (!rays.common || f.bumpy || f.mirrored.radius >= FAR) return false;
  if (any(mirror & ~(hit.geom == splat(0)))) return false;
  const float* r = f.geoms[0].rotation;
  if (any(mirror & (dot(rays.direction, splat(V3{r[2], r[5], r[8]})) > -1e-4f))) return false;
  return !any_towards(f.mirrored, rays.origin, rays.direction, mirror);
}

}  // namespace
}  // namespace evs::EVS_SPACE
