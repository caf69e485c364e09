// Find the geoms that rays may touch: by a scan of all, or through the hierarchy over many.
#pragma once

#include "base/simd_target.h"
#include "render/geometry/ray_cone.inl"
#include "render/simd/vec.inl"
#include "scene/scene.h"

namespace evs {

// A set of geoms that can be read in ascending order. Making one is cheap: words are cleared on
// first use.
struct GeomSet {
  static constexpr int WORDS = GeomBvh::MAX_GEOMS / 64;
  uint64_t used[WORDS / 64];  // words that have members
  uint64_t words[WORDS];

  EVS_INLINE GeomSet() : used{} {}

  EVS_INLINE void add(int geom) {
    int word = geom / 64;
    uint64_t bit = uint64_t{1} << word % 64, member = uint64_t{1} << geom % 64;
    words[word] = used[word / 64] & bit ? words[word] | member : member;
    used[word / 64] |= bit;
  }
  // Call visit(geom) for each, until it returns true.
  template <class Visit>
  EVS_INLINE void visit(Visit visit) const {
    for (int i = 0; i < WORDS / 64; i++) {
      for (uint64_t left = used[i]; left; left &= left - 1) {
        int word = i * 64 + __builtin_ctzll(left);
        for (uint64_t members = words[word]; members; members &= members - 1) {
          if (visit(word * 64 + __builtin_ctzll(members))) return;
        }
      }
    }
  }
};

// find_geoms in 16 lanes, for kernels in 32.
void find_geoms_avx512(const GeomBvh&, const RayCone&, GeomSet&);

}  // namespace evs

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

// Add the geoms that the rays of `active` may touch before `t_max`, or may come near: `reach` times
// as near as they are far. In: a cone around all of that.
inline void find_candidates(const GeomBvh& bvh, const Rays& rays, const RayCone& cone, Mask active,
                            Float t_max, float reach, GeomSet& found) {
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
    float square = 0;
    if (to_bits(near) & (to_bits(near) - 1)) {
      float length = reduce_max(select(near, t_max, splat(0.0f)));
      BoundingBox starts = bounding_box(rays.origin, 0.0f, near);
      bundle = ray_cone(starts, rays.direction, near, length, square);
    }
    if (reach > 0) open_cone(bundle, square, reach);
    find_geoms(bvh, bundle, found);
    // a ray that is not finite is near none
    active = active & ~(near | mask_from_bits(1u << i));
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
