// Culling: skip shadow rays and mirror rays that can hit nothing, and lights that are out of range.
#pragma once

#include "geometry/ray_cone.inl"
#include "scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Can a ray of `active` come near the sphere? The slack is that of `any_ray_near`.
EVS_INLINE bool any_ray_near_sphere(const BoundingSphere& sphere, Vec origin, Vec direction,
                                    Mask active) {
  if (sphere.radius < 0) return false;
  Vec v = splat(sphere.center) - origin;
  Float along = dot(v, direction);
  Vec across = v - direction * along;
  Float reach = abs(along) * 2e-6f + sphere.radius * 1.000002f;
  return any(active & (along >= -reach) & (dot(across, across) <= reach * reach));
}

struct BoundingSpherePacket {
  Vec center;
  Float radius;
};

// Find the spheres that the light may reach: those in its cone and its range. Non-finite spheres
// count as reached.
EVS_INLINE Mask light_reaches(const Light& light, const BoundingSpherePacket& spheres) {
  // only the cone and the range bound a light
  Mask outside = mask_from_bits(0);
  bool spot = light.kind == SPOT, ends = light.kind != DIRECTIONAL && light.fade > 0;
  if (light.kind == IMAGE || !(spot || ends)) return ~outside;
  Vec w = spheres.center - splat(light.position);
  Float away = sqrt(dot(w, w));
  V3 p = light.position;
  float place = __builtin_fabsf(p.x) + __builtin_fabsf(p.y) + __builtin_fabsf(p.z);
  // slack for the rounding of positions, and of directions over the distance
  Float slack = spheres.radius * 1.00001f + (away * 1e-5f + place * 1e-6f);
  // test the cone
  if (spot) {
    // 2e-6 covers the rounding of the cosine that is compared with cos_cutoff
    float cosine = light.cos_cutoff - 2e-6f;
    cosine = cosine > -1.0f ? cosine : -1.0f;
    float square = 1.0f - cosine * cosine, sine = __builtin_sqrtf(square > 0 ? square : 0);
    Float along = dot(w, splat(light.direction));
    Vec off = w - splat(light.direction) * along;
    // distance of the centre from the cone's side
    outside = sqrt(dot(off, off)) * cosine - along * sine > slack;
  }
  // test the range
  if (ends) {
    Float nearest = away - slack;
    outside = outside | ((nearest > 0.0f) & (nearest * nearest * light.fade > 1.0001f));
  }
  return ~outside;
}

// Can a plane occlude a light, given the planes that never do (`non_occluders`)?
EVS_INLINE bool planes_may_occlude(const Frame& f, uint32_t non_occluders) {
  uint32_t planes = f.plane_count < 32 ? (1u << f.plane_count) - 1 : ~0u;
  return f.plane_count > 32 || (planes & ~non_occluders);
}

// The bounding box of the points of an interaction, computed on first use.
struct LazyBounds {
  BoundingBox box;
  bool known = false;

  template <class Interaction>
  const BoundingBox& of(const Interaction& interaction, Mask lit) {
    if (!known) box = bounding_box(interaction.spawn_point, interaction.step, lit);
    known = true;
    return box;
  }
};

// Is the mirror image in the only plane, a flat one, empty? A camera ray sees in the mirror what it
// would hit behind the plane. Grazing rays are never culled.
EVS_INLINE bool mirror_is_empty(const Frame& f, const Rays& rays, const Hit& hit, Mask mirror) {
  if (!rays.common || f.normal_mapped || f.mirrored_bounds.radius >= T_INFINITY) return false;
  if (any(mirror & ~(hit.geom == splat(0)))) return false;
  const float* r = f.geoms[0].rotation;
  if (any(mirror & (dot(rays.direction, splat(V3{r[2], r[5], r[8]})) > -1e-4f))) return false;
  return !any_ray_near_sphere(f.mirrored_bounds, rays.origin, rays.direction, mirror);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
