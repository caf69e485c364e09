// Rays against the whole frame: what is hit first, and what stands in the way of a light.
#pragma once

#include "geometry/bvh_traversal.inl"
#include "geometry/ray_cone.inl"
#include "geometry/shapes.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

EVS_INLINE Vec local_origin(const Geom& g, const Rays& rays) {
  if (rays.common) return splat(g.camera);
  return to_local(g.rotation, rays.origin - splat(g.position));
}

// Rays so far apart that their hull tells little; each may be asked whether it comes near a geom.
EVS_INLINE bool scattered(const Hull& hull) { return hull.radius >= FAR || hull.cosine < 0.95f; }

// Geoms that the hull may touch come before this one: most hulls meet planes or nothing.
EVS_INLINE int end_of(const Frame& f, const Hull& hull) {
  return f.geom_count <= LANES || may_touch(f.around, hull) ? f.geom_count : f.plane_count;
}

// Geoms k ... k+15 of those before `end` that the hull may touch, one bit each.
EVS_INLINE unsigned candidates(const Frame& f, int k, int end, const Hull& hull) {
  unsigned all = end - k < LANES ? (1u << (end - k)) - 1 : ALL_LANES;
  // where all are few, or the hull is everywhere, there is nothing to save
  if (end <= 2 || hull.radius >= FAR) return all;
  return touching(f.bounds, k, hull) & all;
}

// Can one of `active` touch the ball around geom `index`? With the slack of `touching`.
EVS_INLINE bool any_near(const Frame& f, int index, const Rays& rays, Mask active) {
  if (f.geoms[index].shape == PLANE) return true;
  const Bounds& b = f.bounds;
  Vec v = splat(V3{b.x[index], b.y[index], b.z[index]}) - rays.origin;
  Float along = dot(v, rays.direction);
  Vec across = v - rays.direction * along;
  Float reach = abs(along) * 2e-6f + b.radius[index] * 1.000002f;
  return any(active & (along >= -reach) & (dot(across, across) <= reach * reach));
}

// What the rays of `active` hit first after `beyond`.
inline Hit closest(const Frame& f, const Rays& rays, const Hull& hull, Mask active, Float beyond) {
  Hit hit = {select(active, splat(FAR), splat(-1.0f)), splat(-1), splat(0), splat(0.0f),
             splat(0.0f)};
  bool apart = scattered(hull);
  for (int k = 0, end = end_of(f, hull); k < end; k += LANES) {
    for (unsigned near = candidates(f, k, end, hull); near; near &= near - 1) {
      int index = k + first_lane(near);
      if (apart && !any_near(f, index, rays, active)) continue;
      const Geom& g = f.geoms[index];
      Vec o = local_origin(g, rays), d = to_local(g.rotation, rays.direction);
      if (g.shape == MESH || g.shape == HFIELD) {
        Mask nearer = enter_mesh(f.meshes[g.mesh], mesh_rays(f.meshes[g.mesh], o, d), beyond,
                                 hit.distance, hit.triangle, hit.u, hit.v);
        hit.geom = select(nearer, splat(index), hit.geom);
        continue;
      }
      Float t = enter_shape(g, o, d);
      Mask nearer = (t < hit.distance) & (t > beyond);
      hit.distance = select(nearer, t, hit.distance);
      hit.geom = select(nearer, splat(index), hit.geom);
    }
  }
  return hit;
}

// Lanes whose ray from `origin` along `direction` meets something before `limit`.
// `self`: the geom that the ray starts on; a convex shape cannot shade a point of its own. `idle`:
// geoms of the first 32 that are known to be out of the way, one bit each.
inline Mask occluded(const Frame& f, Vec origin, Vec direction, Float limit, Int self,
                     const Hull& hull, Mask wanted, unsigned idle) {
  Mask blocked = mask_of(0);
  Rays rays = {origin, direction, false};
  bool apart = scattered(hull);
  for (int k = 0, end = end_of(f, hull); k < end; k += LANES) {
    unsigned near = candidates(f, k, end, hull);
    if (k < 32) near &= ~(idle >> k);
    for (; near; near &= near - 1) {
      int index = k + first_lane(near);
      const Geom& g = f.geoms[index];
      bool is_mesh = g.shape == MESH || g.shape == HFIELD;
      Mask asked = wanted & ~blocked;
      if (!is_mesh) asked = asked & ~(self == splat(index));
      if (!any(asked) || (apart && !any_near(f, index, rays, asked))) continue;
      Vec o = local_origin(g, rays), d = to_local(g.rotation, direction);
      if (is_mesh) {
        blocked = blocked | blocked_by_mesh(f.meshes[g.mesh], mesh_rays(f.meshes[g.mesh], o, d),
                                            limit, asked);
      } else {
        blocked = blocked | (asked & (enter_shape(g, o, d) < limit));
      }
      if (!any(wanted & ~blocked)) return blocked;
    }
  }
  return blocked;
}

}  // namespace
}  // namespace evs::EVS_SPACE
