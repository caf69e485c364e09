// Intersect rays with the whole scene: the nearest hit, and occlusion.
#pragma once

#include "geometry/bvh_traversal.inl"
#include "geometry/ray_cone.inl"
#include "geometry/shapes.inl"
#include "scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Vec local_origin(const Geom& g, const Rays& rays) {
  if (rays.common) return splat(g.camera);
  return to_local(g.rotation, rays.origin - splat(g.position));
}

// Is the cone so wide that it culls little? Then each ray is tested against each bounding sphere.
EVS_INLINE bool is_wide(const RayCone& cone) {
  return cone.radius >= T_INFINITY || cone.cosine < 0.95f;
}

// End of the geoms that the cone may touch. Most cones meet only planes, or nothing.
EVS_INLINE int candidates_end(const Frame& f, const RayCone& cone) {
  return f.geom_count <= LANES || cone_may_touch(f.finite_bounds, cone) ? f.geom_count
                                                                        : f.plane_count;
}

// Find geoms k ... k+15 before `end` that the cone may touch, one bit each.
EVS_INLINE unsigned candidates(const Frame& f, int k, int end, const RayCone& cone) {
  unsigned all = end - k < LANES ? (1u << (end - k)) - 1 : ALL_LANES;
  // with few geoms, or a cone that bounds everything, culling saves nothing
  if (end <= 2 || cone.radius >= T_INFINITY) return all;
  return cone_touches(f.bounds, k, cone) & all;
}

// Can a ray of `active` touch the bounding sphere of geom `index`? The slack is that of
// `cone_touches`.
EVS_INLINE bool any_ray_near(const Frame& f, int index, const Rays& rays, Mask active) {
  if (f.geoms[index].shape == PLANE) return true;
  const BoundingSphereArray& b = f.bounds;
  Vec v = splat(V3{b.x[index], b.y[index], b.z[index]}) - rays.origin;
  Float along = dot(v, rays.direction);
  Vec across = v - rays.direction * along;
  Float reach = abs(along) * 2e-6f + b.radius[index] * 1.000002f;
  return any(active & (along >= -reach) & (dot(across, across) <= reach * reach));
}

// Find the nearest hit of the rays of `active` behind `t_min`.
inline Hit intersect(const Frame& f, const Rays& rays, const RayCone& cone, Mask active,
                     Float t_min) {
  Hit hit = {select(active, splat(T_INFINITY), splat(-1.0f)), splat(-1), splat(0), splat(0.0f),
             splat(0.0f)};
  bool wide = is_wide(cone);
  for (int k = 0, end = candidates_end(f, cone); k < end; k += LANES) {
    for (unsigned near = candidates(f, k, end, cone); near; near &= near - 1) {
      int index = k + first_lane(near);
      if (wide && !any_ray_near(f, index, rays, active)) continue;
      // transform the rays to the geom's frame
      const Geom& g = f.geoms[index];
      Vec o = local_origin(g, rays), d = to_local(g.rotation, rays.direction);
      // keep the nearer hits
      if (g.shape == MESH || g.shape == HFIELD) {
        Mask nearer = intersect_mesh(f.meshes[g.mesh], mesh_rays(f.meshes[g.mesh], o, d), t_min,
                                     hit.distance, hit.triangle, hit.u, hit.v);
        hit.geom = select(nearer, splat(index), hit.geom);
        continue;
      }
      Float t = intersect_shape(g, o, d);
      Mask nearer = (t < hit.distance) & (t > t_min);
      hit.distance = select(nearer, t, hit.distance);
      hit.geom = select(nearer, splat(index), hit.geom);
    }
  }
  return hit;
}

// Find the lanes whose ray is occluded before `t_max`. `self`: the geom that the ray starts on; a
// convex shape cannot shade itself. `non_occluders`: geoms of the first 32 that are known not to
// occlude, one bit each.
inline Mask occluded(const Frame& f, Vec origin, Vec direction, Float t_max, Int self,
                     const RayCone& cone, Mask active, unsigned non_occluders) {
  Mask blocked = mask_from_bits(0);
  Rays rays = {origin, direction, false};
  bool wide = is_wide(cone);
  for (int k = 0, end = candidates_end(f, cone); k < end; k += LANES) {
    unsigned near = candidates(f, k, end, cone);
    if (k < 32) near &= ~(non_occluders >> k);
    for (; near; near &= near - 1) {
      int index = k + first_lane(near);
      const Geom& g = f.geoms[index];
      // skip the geom if no lane can hit it
      bool is_mesh = g.shape == MESH || g.shape == HFIELD;
      Mask tested = active & ~blocked;
      if (!is_mesh) tested = tested & ~(self == splat(index));
      if (!any(tested) || (wide && !any_ray_near(f, index, rays, tested))) continue;
      // intersect the others, until every lane is blocked
      Vec o = local_origin(g, rays), d = to_local(g.rotation, direction);
      if (is_mesh) {
        blocked = blocked |
                  occluded_mesh(f.meshes[g.mesh], mesh_rays(f.meshes[g.mesh], o, d), t_max, tested);
      } else {
        blocked = blocked | (tested & (intersect_shape(g, o, d) < t_max));
      }
      if (!any(active & ~blocked)) return blocked;
    }
  }
  return blocked;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
