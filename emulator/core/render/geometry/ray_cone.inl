// A cone around a packet of rays: which geoms the rays may hit is asked of the cone first.
#pragma once

#include "geometry/rays.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

// Geoms k ... k+15 whose bounding sphere the hull can touch, one bit each.
// Conservative: the slack covers the rounding of everything computed here, and a ray on the rim.
EVS_INLINE unsigned touching(const Bounds& b, int k, const Hull& hull) {
  Vec v = {load(b.x + k) - hull.center.x, load(b.y + k) - hull.center.y,
           load(b.z + k) - hull.center.z};
  Float along = v.x * hull.axis.x + v.y * hull.axis.y + v.z * hull.axis.z;
  // the part across the axis by subtraction of vectors: no cancellation of squares
  Vec across = {v.x - along * hull.axis.x, v.y - along * hull.axis.y, v.z - along * hull.axis.z};
  Float reach = load(b.radius + k) + hull.radius;
  Float slack = (abs(along) + reach) * 2e-6f;
  // distance from the axis, times the cosine, against how far the ball and the opening reach
  Float allowed = along * hull.sine + (reach + slack);
  Mask near =
      (allowed >= 0.0f) & (dot(across, across) * (hull.cosine * hull.cosine) <= allowed * allowed);
  Mask ahead = along >= -reach - slack;
  Mask before = along - reach <= splat(hull.length) + slack;
  Mask real = load(b.radius + k) >= 0.0f;  // padding has a negative radius
  return bits(near & ahead & before & real);
}

// The same test for one ball, with more slack than `touching`: what it refuses, that refuses too.
EVS_INLINE bool may_touch(const Ball& ball, const Hull& hull) {
  V3 v = ball.center - hull.center;
  float along = dot(v, hull.axis);
  V3 across = v - scaled(hull.axis, along);
  float reach = ball.radius + hull.radius;
  float slack = (__builtin_fabsf(along) + reach) * 1e-5f;
  float allowed = along * hull.sine + (reach + slack);
  return allowed >= 0 && dot(across, across) * (hull.cosine * hull.cosine) <= allowed * allowed &&
         along >= -reach - slack && along - reach <= hull.length + slack && ball.radius >= 0;
}

// Open a hull as far as the largest squared chord between its axis and a ray's direction. Chords
// keep a small angle where its cosine would be rounded away; 1e-6 covers that directions and axis
// are units but for their rounding.
EVS_INLINE void open(Hull& hull, float square) {
  float chord = __builtin_sqrtf(square) + 1e-6f;
  // a spread past 60 degrees: everything ahead and behind counts
  if (!(chord < 1.0f)) {
    hull.radius = FAR;
    chord = 1.0f;
  }
  hull.cosine = 1.0f - 0.5f * chord * chord;
  hull.sine = chord * __builtin_sqrtf(1.0f - 0.25f * chord * chord);
}

// Half the diagonal of a box of points around `center`, and the rounding of their coordinates.
EVS_INLINE float radius_of(V3 center, V3 high) {
  V3 half = high - center;
  float away = __builtin_fabsf(center.x) + __builtin_fabsf(center.y) + __builtin_fabsf(center.z);
  return __builtin_sqrtf(dot(half, half)) * 1.00001f + away * 5e-7f;
}

EVS_INLINE Region region_of(Vec p, float step, Mask active) {
  auto low = [&](Float x) { return lowest(select(active, x, splat(FAR))); };
  auto high = [&](Float x) { return highest(select(active, x, splat(-FAR))); };
  return {{low(p.x), low(p.y), low(p.z)}, {high(p.x), high(p.y), high(p.z)}, step};
}

EVS_INLINE void grow(Region& r, const Region& by) {
  r.step = by.step > r.step ? by.step : r.step;
  auto widen = [](float& low, float& high, float a, float b) {
    low = a < low ? a : low;
    high = b > high ? b : high;
  };
  widen(r.low.x, r.high.x, by.low.x, by.high.x);
  widen(r.low.y, r.high.y, by.low.y, by.high.y);
  widen(r.low.z, r.high.z, by.low.z, by.high.z);
}

EVS_INLINE Hull ball_of(const Region& r) {
  Hull hull;
  hull.center = {0.5f * (r.low.x + r.high.x), 0.5f * (r.low.y + r.high.y),
                 0.5f * (r.low.z + r.high.z)};
  hull.radius = radius_of(hull.center, r.high);
  hull.axis = {0, 0, -1};
  hull.length = 0;
  hull.cosine = 1;
  hull.sine = 0;
  return hull;
}

// Largest squared chord between `axis` and the directions of the active lanes.
EVS_INLINE float spread(Vec d, V3 axis, Mask active) {
  Vec apart = d - splat(axis);
  return highest(select(active, dot(apart, apart), splat(0.0f)));
}

// The hull of the active lanes' rays: from points in `starts`, along directions d, no further than
// `length`. Out: `square`, the largest squared chord between its axis and a ray.
EVS_INLINE Hull hull_of(const Region& starts, Vec d, Mask active, float length, float& square) {
  Hull hull = ball_of(starts);
  hull.length = length;
  int first = first_lane(bits(active));
  hull.axis = normalized({lane(d.x, first), lane(d.y, first), lane(d.z, first)});
  square = spread(d, hull.axis, active);
  open(hull, square);
  return hull;
}
EVS_INLINE Hull hull_of(Vec p, Vec d, Mask active, float length) {
  float square;
  return hull_of(region_of(p, 0.0f, active), d, active, length, square);
}

}  // namespace
}  // namespace evs::EVS_SPACE
