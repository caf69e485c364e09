// Clearance: how far moving geoms may travel before one of them could touch a sample's rays.
#pragma once

#include "render/geometry/rays.inl"
#include "scene/path_scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// The rays that leave the first hits of a packet of samples, as PathCacheView stores them.
struct SecondaryRays {
  Vec direction[SECONDARY_RAYS];
  Float t_max[SECONDARY_RAYS];
  Mask complete;  // lanes whose rays all fit
};

struct Clearance {
  const PathCacheView* cache;
  Float gap;    // to the nearest capsule that no ray touches; below 0: a moving geom was hit
  Int touched;  // bits of the capsules that a ray touches
  SecondaryRays* secondary;  // where to record rays; or null
};

constexpr float DIRTY = -T_INFINITY;  // the gap of samples that must be traced in the next tick

// Record that the rays of `lanes` hit these geoms.
EVS_INLINE void note_hit(Clearance& c, Int geom, Mask lanes) {
  if (!any(lanes)) return;  // there may be no geom at all
  Int moving = as_int(
      gather(reinterpret_cast<const float*>(c.cache->moving), select(lanes, geom, splat(0))));
  c.gap = select(lanes & ~(moving == splat(0)), splat(DIRTY), c.gap);
}

// How near the capsules come to rays that end at `t_max`, and how firmly one occludes them.
struct RayClearance {
  Float gap;    // to the nearest capsule that they do not touch
  Int touched;  // bits of the others
  Float depth;  // how far an occluding solid capsule may move and still occlude; 0: none does
};

// Measure the clearance. It is conservative: uncertain gaps count as smaller, uncertain depths as
// shallower. `solid`: count occlusion by solid capsules.
inline RayClearance ray_clearance(const Clearance& c, Vec origin, Vec d, Float t_max, Mask lanes,
                                  bool solid) {
  Float zero = splat(0.0f);
  RayClearance p = {c.gap, splat(0), zero};
  for (int i = 0; i < c.cache->capsule_count; i++) {
    const BoundingCapsule& capsule = c.cache->capsules[i];
    Vec w = origin - splat(capsule.center);
    Float along = dot(w, d);
    // skip capsules whose bounding sphere is farther away than the current gap
    Float t = min(max(-along, zero), t_max);
    Vec apart = w + d * t;
    Float known = p.gap + (capsule.half + capsule.radius);
    Mask tested = lanes & ~(dot(apart, apart) > known * known * 1.001f);
    if (!any(tested)) continue;
    if (capsule.half > 0) {
      // nearest points of two segments; 1e-5: nearly parallel lines, for which the radius leaves
      // room
      Vec axis = splat(capsule.axis);
      Float on_axis = dot(w, axis), cosine = dot(d, axis);
      t = (cosine * on_axis - along) / max(1.0f - cosine * cosine, splat(1e-5f));
      t = min(max(t, zero), t_max);
      Float s = min(max(cosine * t + on_axis, splat(-capsule.half)), splat(capsule.half));
      t = min(max(cosine * s - along, zero), t_max);
      apart = w + d * t - axis * s;
    }
    // 1e-4: the rounding of the above
    Float distance = sqrt(dot(apart, apart));
    Float gap = distance * 0.9998f - (t * 1e-4f + capsule.radius);
    Mask clear = gap > 0.0f, touching = tested & ~clear;
    p.gap = select(tested & clear, min(gap, p.gap), p.gap);
    if (!any(touching)) continue;
    p.touched = select(touching, p.touched | splat(static_cast<int>(capsule.bit)), p.touched);
    if (!solid || !(capsule.solid > 0)) continue;
    // the capsule occludes rays that enter it from outside and pass close enough to its axis
    Float s = min(max(dot(w, splat(capsule.axis)), splat(-capsule.half)), splat(capsule.half));
    Vec off = w - splat(capsule.axis) * s;
    Float outside = sqrt(dot(off, off)) * 0.9998f - capsule.radius;
    Float inside = capsule.solid - (distance * 1.0002f + t * 1e-4f);
    p.depth = select(touching, max(p.depth, min(inside, outside)), p.depth);
  }
  return p;
}

EVS_INLINE void add_clearance(Clearance& c, const RayClearance& p, Mask lanes) {
  Mask moves = lanes & ~((p.touched & splat(static_cast<int>(c.cache->moved))) == splat(0));
  c.gap = select(lanes, select(moves, splat(DIRTY), min(p.gap, c.gap)), c.gap);
  c.touched = select(lanes, c.touched | p.touched, c.touched);
}

// Record a ray in the first free place of each lane, independent of the other lanes.
inline void add_secondary_ray(SecondaryRays* secondary, Vec d, Float t_max, Mask lanes) {
  if (!secondary) return;
  for (int i = 0; i < SECONDARY_RAYS && any(lanes); i++) {
    Mask taken = (secondary->t_max[i] < 0.0f) | (secondary->t_max[i] > 0.0f), here = lanes & ~taken;
    secondary->direction[i] = select(here, d, secondary->direction[i]);
    secondary->t_max[i] = select(here, t_max, secondary->t_max[i]);
    lanes = lanes & taken;
  }
  secondary->complete = secondary->complete & ~lanes;
}

// Record each ray of `lanes` up to `t_max`.
inline void note_ray(Clearance& c, Vec origin, Vec d, Float t_max, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  add_secondary_ray(c.secondary, d, t_max, lanes);
  add_clearance(c, ray_clearance(c, origin, d, t_max, lanes, false), lanes);
}

// Record shadow rays, for which only occlusion counts: the occluder may move as long as it still
// occludes.
inline void note_shadow_ray(Clearance& c, Vec origin, Vec d, Float t_max, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  RayClearance p = ray_clearance(c, origin, d, t_max, lanes, true);
  Mask occluded_lanes = lanes & (p.depth > 0.0f);
  add_secondary_ray(c.secondary, d, select(occluded_lanes, -t_max, t_max), lanes);
  c.gap = select(occluded_lanes, min(p.depth, c.gap), c.gap);
  add_clearance(c, p, lanes & ~occluded_lanes);
}

// Record rays that were occluded; a sample whose ray no longer is gets traced in the next tick.
inline void note_occluded_ray(Clearance& c, Vec origin, Vec d, Float t_max, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  Float depth = ray_clearance(c, origin, d, t_max, lanes, true).depth;
  c.gap = select(lanes, select(depth > 0.0f, min(depth, c.gap), splat(DIRTY)), c.gap);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
