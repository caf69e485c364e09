// How far everything that moves may go before it could meet one of a sample's rays.
#pragma once

#include "geometry/rays.inl"
#include "path_scene.h"

namespace evs::EVS_SPACE {
namespace {

// The rays that leave the first points of a packet of samples, as KeptLight keeps them.
struct Fan {
  Vec towards[FAN_RAYS];
  Float limit[FAN_RAYS];
  Mask fits;  // lanes of which there were no more
};

struct Clearance {
  const KeptLight* kept;
  Float gap;    // to the nearest rod that no ray meets; below 0: one that moves was met
  Int touched;  // bits of the rods that a ray meets
  Fan* fan;     // where rays are noted; or null
};

constexpr float MET = -FAR;  // the gap of what is traced again in the next tick, whatever happens

// The rays of `lanes` end on these geoms.
EVS_INLINE void meet(Clearance& c, Int geom, Mask lanes) {
  if (!any(lanes)) return;  // there may be no geom at all
  Int moving =
      as_int(gather(reinterpret_cast<const float*>(c.kept->moving), select(lanes, geom, splat(0))));
  c.gap = select(lanes & ~(moving == splat(0)), splat(MET), c.gap);
}

// How near the rods come to rays of `lanes`, which end at `limit`, and how firmly one bars their
// way.
struct Passage {
  Float gap;    // to the nearest rod that they do not meet
  Int touched;  // bits of the others
  Float depth;  // so far a solid rod that they enter may move until one does not; 0: there is none
};

// Whatever it is unsure of counts as nearer, and as less deep. `solid`: rods that are solid count.
inline Passage passage(const Clearance& c, Vec origin, Vec d, Float limit, Mask lanes, bool solid) {
  Float zero = splat(0.0f);
  Passage p = {c.gap, splat(0), zero};
  for (int i = 0; i < c.kept->rod_count; i++) {
    const Rod& rod = c.kept->rods[i];
    Vec w = origin - splat(rod.center);
    Float along = dot(w, d);
    // the ball around the rod: is it nearer than what is known already?
    Float t = min(max(-along, zero), limit);
    Vec apart = w + d * t;
    Float known = p.gap + (rod.half + rod.radius);
    Mask asked = lanes & ~(dot(apart, apart) > known * known * 1.001f);
    if (!any(asked)) continue;
    if (rod.half > 0) {
      // nearest points of two segments. 1e-5: lines so parallel that each point is as near as the
      // others; the radius has room for it
      Vec axis = splat(rod.axis);
      Float on_axis = dot(w, axis), cosine = dot(d, axis);
      t = (cosine * on_axis - along) / max(1.0f - cosine * cosine, splat(1e-5f));
      t = min(max(t, zero), limit);
      Float s = min(max(cosine * t + on_axis, splat(-rod.half)), splat(rod.half));
      t = min(max(cosine * s - along, zero), limit);
      apart = w + d * t - axis * s;
    }
    // 1e-4: the rounding of all this
    Float distance = sqrt(dot(apart, apart));
    Float gap = distance * 0.9998f - (t * 1e-4f + rod.radius);
    Mask clear = gap > 0.0f, met = asked & ~clear;
    p.gap = select(asked & clear, min(gap, p.gap), p.gap);
    if (!any(met)) continue;
    p.touched = select(met, p.touched | splat(static_cast<int>(rod.bit)), p.touched);
    if (!solid || !(rod.solid > 0)) continue;
    // it is entered from outside, by rays that come so near to its axis
    Float s = min(max(dot(w, splat(rod.axis)), splat(-rod.half)), splat(rod.half));
    Vec off = w - splat(rod.axis) * s;
    Float away = sqrt(dot(off, off)) * 0.9998f - rod.radius;
    Float inside = rod.solid - (distance * 1.0002f + t * 1e-4f);
    p.depth = select(met, max(p.depth, min(inside, away)), p.depth);
  }
  return p;
}

EVS_INLINE void add_passage(Clearance& c, const Passage& p, Mask lanes) {
  Mask moves = lanes & ~((p.touched & splat(static_cast<int>(c.kept->moved))) == splat(0));
  c.gap = select(lanes, select(moves, splat(MET), min(p.gap, c.gap)), c.gap);
  c.touched = select(lanes, c.touched | p.touched, c.touched);
}

// Which packets lanes go in has no part in where they find room.
inline void add_ray(Fan* fan, Vec d, Float limit, Mask lanes) {
  if (!fan) return;
  for (int i = 0; i < FAN_RAYS && any(lanes); i++) {
    Mask taken = (fan->limit[i] < 0.0f) | (fan->limit[i] > 0.0f), here = lanes & ~taken;
    fan->towards[i] = select(here, d, fan->towards[i]);
    fan->limit[i] = select(here, limit, fan->limit[i]);
    lanes = lanes & taken;
  }
  fan->fits = fan->fits & ~lanes;
}

// The part of each ray of `lanes` up to `limit`.
inline void note(Clearance& c, Vec origin, Vec d, Float limit, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  add_ray(c.fan, d, limit, lanes);
  add_passage(c, passage(c, origin, d, limit, lanes, false), lanes);
}

// The same for rays of which nothing counts but whether something opaque is in their way: it may
// move as long as it stays there.
inline void note_shadow(Clearance& c, Vec origin, Vec d, Float limit, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  Passage p = passage(c, origin, d, limit, lanes, true);
  Mask barred = lanes & (p.depth > 0.0f);
  add_ray(c.fan, d, select(barred, -limit, limit), lanes);
  c.gap = select(barred, min(p.depth, c.gap), c.gap);
  add_passage(c, p, lanes & ~barred);
}

// The same for rays that were barred: in the next tick is traced again what is so no longer.
inline void note_barred(Clearance& c, Vec origin, Vec d, Float limit, Mask lanes) {
  lanes = lanes & (c.gap >= 0.0f);
  if (!any(lanes)) return;
  Float depth = passage(c, origin, d, limit, lanes, true).depth;
  c.gap = select(lanes, select(depth > 0.0f, min(depth, c.gap), splat(MET)), c.gap);
}

}  // namespace
}  // namespace evs::EVS_SPACE
