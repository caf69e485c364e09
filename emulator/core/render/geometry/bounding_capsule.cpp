#include "render/geometry/bounding_capsule.h"

#include <algorithm>
#include <cmath>

#include "base/reproducible_math.h"

namespace evs {

BoundingCapsule bounding_capsule(const Geom& g, const BoundingSphere& sphere) {
  const float* s = g.size;
  float half = 0, radius = 0;
  int axis = 2;
  switch (g.shape) {
    case CAPSULE:
    case CYLINDER:
      half = s[1];
      radius = s[0];
      break;
    case ELLIPSOID:
    case BOX: {
      axis = s[0] > s[1] ? (s[0] > s[2] ? 0 : 2) : (s[1] > s[2] ? 1 : 2);
      float a = s[(axis + 1) % 3], b = s[(axis + 2) % 3];
      radius = g.shape == BOX ? hypotenuse(a, b) : std::max(a, b);
      half = g.shape == BOX ? s[axis] : s[axis] - radius;
      break;
    }
    default:
      return {
          sphere.center, {0, 0, 1}, 0, sphere.radius, g.shape == SPHERE ? s[0] * 0.9999f : 0, 0};
  }
  auto cube = [](float x) { return x * x * x; };
  if (radius * radius * half * 1.5f + cube(radius) >= cube(sphere.radius)) {
    return {sphere.center, {0, 0, 1}, 0, sphere.radius, 0, 0};
  }
  // leave room for the rounding of the position, and for what `ray_clearance` neglects between
  // nearly parallel lines
  V3 c = g.position;
  float away = std::abs(c.x) + std::abs(c.y) + std::abs(c.z);
  float solid = g.shape == CAPSULE ? radius * 0.9999f - away * 5e-7f : 0;
  radius = radius * 1.0001f + half * 0.007f + away * 5e-7f;
  V3 along = {g.rotation[axis], g.rotation[3 + axis], g.rotation[6 + axis]};
  return {c, along, half, radius, solid, 0};
}

}  // namespace evs
