// Find the geoms that rays may touch: by a scan of all, or through the hierarchy over many.
#pragma once

#include "render/geometry/geom_bvh_traversal.inl"
#include "render/geometry/ray_cone.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Is the cone so wide that it culls little? Then each ray is tested against each bounding sphere.
EVS_INLINE bool is_wide(const RayCone& cone) {
  return cone.radius >= T_INFINITY || cone.cosine < 0.95f;
}

// End of the geoms to scan that the cone may touch. Most cones meet only planes, or nothing.
EVS_INLINE int candidates_end(const Frame& f, const RayCone& cone) {
  if (f.bvh.top > 0) return f.plane_count;
  return f.geom_count <= LANES || cone_may_touch(f.finite_bounds, cone) ? f.geom_count
                                                                        : f.plane_count;
}

// Find geoms k ... k+15 before `end` that the cone may touch, one bit each.
EVS_INLINE unsigned candidates(const Frame& f, int k, int end, const RayCone& cone) {
  unsigned all = first_lanes(end - k);
  // with few geoms, or a cone that bounds everything, culling saves nothing
  if (end <= 2 || cone.radius >= T_INFINITY) return all;
  return cone_touches(f.bounds, k, cone) & all;
}

constexpr float BUNDLE_CHORD = 0.05f;  // between directions of one bundle

// Add the geoms that the rays of `active` may touch before `t_max`. In: a cone around all of them.
inline void find_candidates(const GeomBvh& bvh, const Rays& rays, const RayCone& cone, Mask active,
                            Float t_max, GeomSet& found) {
  if (!is_wide(cone) && cone.radius <= bvh.fine) return find_geoms(bvh, cone, found);
  // a thick cone touches too much: take the rays in bundles
  while (any(active)) {
    int i = first_lane(to_bits(active));
    RayCone bundle = {
        {lane(rays.origin.x, i), lane(rays.origin.y, i), lane(rays.origin.z, i)},
        {lane(rays.direction.x, i), lane(rays.direction.y, i), lane(rays.direction.z, i)},
        0,
        lane(t_max, i),
        1,
        0};
    Vec apart = rays.origin - splat(bundle.center), turned = rays.direction - splat(bundle.axis);
    Mask near = active & (dot(apart, apart) <= bvh.fine * bvh.fine) &
                (dot(turned, turned) <= BUNDLE_CHORD * BUNDLE_CHORD);
    if (to_bits(near) & (to_bits(near) - 1)) {
      float length = reduce_max(select(near, t_max, splat(0.0f)));
      bundle = ray_cone(rays.origin, rays.direction, near, length);
    }
    find_geoms(bvh, bundle, found);
    // a ray that is not finite is near none
    active = active & ~(near | mask_from_bits(1u << i));
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
