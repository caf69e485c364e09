// Culling: skip shadow rays and mirror rays that can hit nothing, and lights that are out of range.
#pragma once

#include "render/geometry/ray_cone.inl"
#include "scene/light.h"
#include "scene/scene.h"

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

// Find the lanes whose sphere is outside a light's cone or its range; not those that are not
// finite.
EVS_INLINE Mask outside_of_light(Vec position, Vec direction, Float cosine, Float sine, Float fade,
                                 Vec center, Float radius) {
  Vec w = center - position;
  Float away = sqrt(dot(w, w));
  Float place = abs(position.x) + abs(position.y) + abs(position.z);
  // slack for the rounding of positions, and of directions over the distance
  Float slack = radius * 1.00001f + (away * 1e-5f + place * 1e-6f);
  Float along = dot(w, direction), nearest = away - slack;
  Vec off = w - direction * along;
  // compare the distance of the centre from the cone's side, and from the light
  return (sqrt(dot(off, off)) * cosine - along * sine > slack) |
         ((nearest > 0.0f) & (nearest * nearest * fade > 1.0001f));
}

// Find the spheres that the light may reach.
EVS_INLINE Mask light_reaches(const Light& light, const BoundingSpherePacket& spheres) {
  LightReach reach = light.reach();
  if (!reach.bounded()) return mask_from_bits(ALL_LANES);
  return ~outside_of_light(splat(light.position), splat(light.direction), splat(reach.cosine),
                           splat(reach.sine), splat(reach.fade), spheres.center, spheres.radius);
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

// Call visit(light) for lights `begin` ... `end` - 1 that may reach a point of `lit`, in this
// order. `bounds`: of the interaction's points there.
template <class Interaction, class Visit>
EVS_INLINE void visit_lights(const Frame& f, int begin, int end, const Interaction& interaction,
                             LazyBounds& bounds, Mask lit, Visit visit) {
  for (int k = begin; k < end; k += LANES) {
    unsigned lights = first_lanes(end - k);
    if (f.cull_lights) {
      const BoundingBox& box = bounds.of(interaction, lit);
      RayCone sphere = bounding_sphere(box);
      const LightReachArray& r = f.reach;
      Vec position = {load(r.x + k), load(r.y + k), load(r.z + k)};
      Vec direction = {load(r.direction_x + k), load(r.direction_y + k), load(r.direction_z + k)};
      Mask outside =
          outside_of_light(position, direction, load(r.cosine + k), load(r.sine + k),
                           load(r.fade + k), splat(sphere.center), splat(sphere.radius + box.step));
      lights &= ~to_bits(outside);
    }
    for (; lights; lights &= lights - 1) visit(k + first_lane(lights));
  }
}

// Can a plane occlude a light, given the planes that never do (`non_occluders`)?
EVS_INLINE bool planes_may_occlude(const Frame& f, uint32_t non_occluders) {
  uint32_t planes = f.plane_count < 32 ? (1u << f.plane_count) - 1 : ~0u;
  return f.plane_count > 32 || (planes & ~non_occluders);
}

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
