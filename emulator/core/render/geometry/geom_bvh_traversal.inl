// Traversal of the hierarchy over geoms by a cone of rays.
#pragma once

#include "render/geometry/geom_set.h"
#include "render/simd/vec.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// A cone, prepared for many boxes.
struct BoxTest {
  V3 center, axis, across;      // across: the axis without its signs
  float radius, slope, length;  // radius at a distance: radius + slope times distance
};

EVS_INLINE BoxTest box_test(const RayCone& cone) {
  // slack for the rounding of everything computed here, and of the cone
  float inverse = 1.000004f / cone.cosine;
  V3 a = cone.axis;
  return {cone.center,
          a,
          {__builtin_fabsf(a.x), __builtin_fabsf(a.y), __builtin_fabsf(a.z)},
          cone.radius * inverse,
          cone.sine * inverse + 4e-6f,
          (cone.length + cone.radius) * 1.000004f};
}

// Find boxes k ... k+15 that the cone can touch, one bit each. Conservative: the boxes and the test
// have room for rounding.
EVS_INLINE unsigned touched_boxes(const BoundingBoxArray& b, int k, const BoxTest& t) {
  V3 a = t.axis, s = t.across;
  Vec v = {load(b.x + k) - t.center.x, load(b.y + k) - t.center.y, load(b.z + k) - t.center.z};
  Vec half = {load(b.half_x + k), load(b.half_y + k), load(b.half_z + k)};
  Float along = v.x * a.x + v.y * a.y + v.z * a.z;
  Float extent = half.x * s.x + half.y * s.y + half.z * s.z;
  // the radius of the cone where the box ends
  Float end = along + extent, radius = end * t.slope + t.radius;
  // separate them along directions at right angles to the cone's axis and to one of the box's
  Mask near = (abs(v.y * a.z - v.z * a.y) <= half.y * s.z + half.z * s.y + radius) &
              (abs(v.z * a.x - v.x * a.z) <= half.z * s.x + half.x * s.z + radius) &
              (abs(v.x * a.y - v.y * a.x) <= half.x * s.y + half.y * s.x + radius);
  return to_bits(near & (end >= -t.radius) & (along - extent <= t.length) & (half.x >= 0.0f));
}

// Add the geoms that the cone may touch.
inline void find_geoms(const GeomBvh& bvh, const RayCone& cone, GeomSet& found) {
  if constexpr (LANES > GeomBvh::WIDTH) return find_geoms_avx512(bvh, cone, found);
  constexpr int WIDTH = GeomBvh::WIDTH;
  BoxTest test = box_test(cone);
  auto touched = [&](int level, int k) {
    unsigned boxes = 0;
    for (int i = 0; i < WIDTH; i += LANES) {
      boxes |= touched_boxes(bvh.boxes[level], k + i, test) << i;
    }
    return boxes;
  };
  for (int k = 0; k < bvh.top; k += WIDTH) {
    for (unsigned upper = touched(2, k); upper; upper &= upper - 1) {
      int i = (k + first_lane(upper)) * WIDTH;
      for (unsigned lower = touched(1, i); lower; lower &= lower - 1) {
        int j = (i + first_lane(lower)) * WIDTH;
        for (unsigned geoms = touched(0, j); geoms; geoms &= geoms - 1) {
          found.add(bvh.geoms[j + first_lane(geoms)]);
        }
      }
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
