// The bounding cone of a packet of rays, which culls geoms before any ray is tested.
#pragma once

#include "render/geometry/rays.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Find spheres k ... k+15 that the cone can touch, one bit each. The test is conservative: its
// slack covers the rounding of everything computed here.
EVS_INLINE unsigned cone_touches(const BoundingSphereArray& b, int k, const RayCone& cone) {
  Vec v = {load(b.x + k) - cone.center.x, load(b.y + k) - cone.center.y,
           load(b.z + k) - cone.center.z};
  Float along = v.x * cone.axis.x + v.y * cone.axis.y + v.z * cone.axis.z;
  // subtract vectors, not squares, so nothing cancels
  Vec across = {v.x - along * cone.axis.x, v.y - along * cone.axis.y, v.z - along * cone.axis.z};
  Float reach = load(b.radius + k) + cone.radius;
  Float slack = (abs(along) + reach) * 2e-6f;
  // compare the distance from the axis, times the cosine, with the reach of sphere and cone
  Float allowed = along * cone.sine + (reach + slack);
  Mask near =
      (allowed >= 0.0f) & (dot(across, across) * (cone.cosine * cone.cosine) <= allowed * allowed);
  Mask ahead = along >= -reach - slack;
  Mask before = along - reach <= splat(cone.length) + slack;
  Mask real = load(b.radius + k) >= 0.0f;  // padding has a negative radius
  return to_bits(near & ahead & before & real);
}

// The same test for one sphere, with more slack: what this rejects, `cone_touches` rejects too.
EVS_INLINE bool cone_may_touch(const BoundingSphere& sphere, const RayCone& cone) {
  V3 v = sphere.center - cone.center;
  float along = dot(v, cone.axis);
  V3 across = v - scaled(cone.axis, along);
  float reach = sphere.radius + cone.radius;
  float slack = (__builtin_fabsf(along) + reach) * 1e-5f;
  float allowed = along * cone.sine + (reach + slack);
  return allowed >= 0 && dot(across, across) * (cone.cosine * cone.cosine) <= allowed * allowed &&
         along >= -reach - slack && along - reach <= cone.length + slack && sphere.radius >= 0;
}

// Open a cone to the largest squared chord between its axis and a ray direction. Chords resolve
// small angles whose cosine would round to 1. The 1e-6 covers the rounding of unit vectors.
EVS_INLINE void open_cone(RayCone& cone, float square) {
  float chord = __builtin_sqrtf(square) + 1e-6f;
  // past 60 degrees the cone bounds everything
  if (!(chord < 1.0f)) {
    cone.radius = T_INFINITY;
    chord = 1.0f;
  }
  cone.cosine = 1.0f - 0.5f * chord * chord;
  cone.sine = chord * __builtin_sqrtf(1.0f - 0.25f * chord * chord);
}

// The same around what is near the rays: `reach` times as near as it is far.
EVS_INLINE void open_cone(RayCone& cone, float square, float reach) {
  float chord = __builtin_sqrtf(square) + reach;
  open_cone(cone, chord * chord);
}

// Return half the diagonal of a box around `center`, plus the rounding of its coordinates.
EVS_INLINE float half_diagonal(V3 center, V3 high) {
  V3 half = high - center;
  float away = __builtin_fabsf(center.x) + __builtin_fabsf(center.y) + __builtin_fabsf(center.z);
  return __builtin_sqrtf(dot(half, half)) * 1.00001f + away * 5e-7f;
}

EVS_INLINE BoundingBox bounding_box(Vec p, float step, Mask active) {
  auto low = [&](Float x) { return reduce_min(select(active, x, splat(T_INFINITY))); };
  auto high = [&](Float x) { return reduce_max(select(active, x, splat(-T_INFINITY))); };
  return {{low(p.x), low(p.y), low(p.z)}, {high(p.x), high(p.y), high(p.z)}, step};
}

EVS_INLINE void extend(BoundingBox& r, const BoundingBox& by) {
  r.step = by.step > r.step ? by.step : r.step;
  auto widen = [](float& low, float& high, float a, float b) {
    low = a < low ? a : low;
    high = b > high ? b : high;
  };
  widen(r.low.x, r.high.x, by.low.x, by.high.x);
  widen(r.low.y, r.high.y, by.low.y, by.high.y);
  widen(r.low.z, r.high.z, by.low.z, by.high.z);
}

EVS_INLINE RayCone bounding_sphere(const BoundingBox& r) {
  RayCone cone;
  cone.center = {0.5f * (r.low.x + r.high.x), 0.5f * (r.low.y + r.high.y),
                 0.5f * (r.low.z + r.high.z)};
  cone.radius = half_diagonal(cone.center, r.high);
  cone.axis = {0, 0, -1};
  cone.length = 0;
  cone.cosine = 1;
  cone.sine = 0;
  return cone;
}

// Return the largest squared chord between `axis` and the directions of the active lanes.
EVS_INLINE float max_squared_chord(Vec d, V3 axis, Mask active) {
  Vec apart = d - splat(axis);
  return reduce_max(select(active, dot(apart, apart), splat(0.0f)));
}

// Bound the active rays that start in `starts` with directions d, up to `length`. Out: `square`,
// the largest squared chord between the cone's axis and a ray.
EVS_INLINE RayCone ray_cone(const BoundingBox& starts, Vec d, Mask active, float length,
                            float& square) {
  RayCone cone = bounding_sphere(starts);
  cone.length = length;
  int first = first_lane(to_bits(active));
  cone.axis = normalized({lane(d.x, first), lane(d.y, first), lane(d.z, first)});
  square = max_squared_chord(d, cone.axis, active);
  open_cone(cone, square);
  return cone;
}
EVS_INLINE RayCone ray_cone(Vec p, Vec d, Mask active, float length) {
  float square;
  return ray_cone(bounding_box(p, 0.0f, active), d, active, length, square);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
