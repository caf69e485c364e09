// Where rays enter the analytic shapes. Rays are in the geom's frame, directions are unit.
//
// Only entering hits count (out of the surface's front, distance > 0): a camera inside a shape sees
// through it, as in MuJoCo's viewer. The distance is FAR where there is no hit. A NaN is no hit.
#pragma once

#include "geometry/rays.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

EVS_INLINE Float enter_plane(const float* size, Vec o, Vec d) {
  Float t = o.z / -d.z;  // of no meaning where it is no hit
  Mask hit = (d.z < 0.0f) & (o.z > 0.0f);
  if (size[0] > 0) hit = hit & (abs(o.x + d.x * t) <= size[0]);
  if (size[1] > 0) hit = hit & (abs(o.y + d.y * t) <= size[1]);
  return select(hit, t, splat(FAR));
}

EVS_INLINE Float enter_sphere(const float* size, Vec o, Vec d) {
  // foot of the perpendicular first: no cancellation between |o|^2 and r^2
  Float b = dot(o, d);
  Vec foot = o - d * b;
  Float discriminant = size[0] * size[0] - dot(foot, foot);
  Float t = -b - sqrt(max(discriminant, splat(0.0f)));
  return select((discriminant > 0.0f) & (t > 0.0f), t, splat(FAR));
}

EVS_INLINE Float enter_ellipsoid(const float* size, Vec o, Vec d) {
  Vec p = {o.x * (1.0f / size[0]), o.y * (1.0f / size[1]), o.z * (1.0f / size[2])};
  Vec q = {d.x * (1.0f / size[0]), d.y * (1.0f / size[1]), d.z * (1.0f / size[2])};
  Float inverse = 1.0f / dot(q, q);
  Float b = dot(p, q) * inverse;
  Vec foot = p - q * b;
  Float discriminant = 1.0f - dot(foot, foot);
  Float t = -b - sqrt(max(discriminant, splat(0.0f)) * inverse);
  return select((discriminant > 0.0f) & (t > 0.0f), t, splat(FAR));
}

// The infinite cylinder around z: where its side is entered and left. False: missed.
EVS_INLINE Mask cross_side(float radius, Vec o, Vec d, Float& enter, Float& leave) {
  Float a = d.x * d.x + d.y * d.y;
  Float inverse = 1.0f / max(a, splat(1e-12f));
  Float b = (o.x * d.x + o.y * d.y) * inverse;
  Float x = o.x - d.x * b, y = o.y - d.y * b;
  Float discriminant = radius * radius - (x * x + y * y);
  Float root = sqrt(max(discriminant, splat(0.0f)) * inverse);
  enter = -b - root;
  leave = root - b;
  return discriminant > 0.0f;
}

EVS_INLINE Float enter_capsule(const float* size, Vec o, Vec d) {
  float radius = size[0], half = size[1];
  Float side, leave;
  Mask crossed = cross_side(radius, o, d, side, leave);
  if (!any(crossed)) return splat(FAR);
  // outside the barrel the cap sphere on that end decides
  Float z = o.z + d.z * side;
  Mask barrel = (abs(z) <= half) & (side > 0.0f);
  Vec p = {o.x, o.y, o.z - select(z < -half, splat(-half), splat(half))};
  Float cap = enter_sphere(size, p, d);
  return select(crossed, select(abs(z) <= half, select(barrel, side, splat(FAR)), cap), splat(FAR));
}

EVS_INLINE Float enter_cylinder(const float* size, Vec o, Vec d) {
  Float side, leave;
  Mask crossed = cross_side(size[0], o, d, side, leave);
  if (!any(crossed)) return splat(FAR);
  Float inverse = safe_inverse(d.z);
  Float a = (-size[1] - o.z) * inverse, b = (size[1] - o.z) * inverse;
  Float near = max(side, min(a, b)), far = min(leave, max(a, b));
  return select(crossed & (near <= far) & (near > 0.0f), near, splat(FAR));
}

EVS_INLINE Float enter_box(const float* size, Vec o, Vec d) {
  Vec inverse = {safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z)};
  Vec reach = {abs(inverse.x) * size[0], abs(inverse.y) * size[1], abs(inverse.z) * size[2]};
  Vec middle = {-(o.x * inverse.x), -(o.y * inverse.y), -(o.z * inverse.z)};
  Float near = max(max(middle.x - reach.x, middle.y - reach.y), middle.z - reach.z);
  Float far = min(min(middle.x + reach.x, middle.y + reach.y), middle.z + reach.z);
  return select((near <= far) & (near > 0.0f), near, splat(FAR));
}

EVS_INLINE Float enter_shape(const Geom& g, Vec o, Vec d) {
  switch (g.shape) {
    case PLANE:
      return enter_plane(g.size, o, d);
    case SPHERE:
      return enter_sphere(g.size, o, d);
    case CAPSULE:
      return enter_capsule(g.size, o, d);
    case ELLIPSOID:
      return enter_ellipsoid(g.size, o, d);
    case CYLINDER:
      return enter_cylinder(g.size, o, d);
    case BOX:
      return enter_box(g.size, o, d);
    default:
      return splat(FAR);
  }
}

// The outward normal of a shape at a local point on it, not normalised.
EVS_INLINE Vec normal_of_shape(const Geom& g, Vec p) {
  const float* s = g.size;
  Float zero = splat(0.0f);
  switch (g.shape) {
    case SPHERE:
      return p;
    case ELLIPSOID:
      return {p.x * (1.0f / (s[0] * s[0])), p.y * (1.0f / (s[1] * s[1])),
              p.z * (1.0f / (s[2] * s[2]))};
    case CAPSULE:
      return {p.x, p.y, p.z - max(splat(-s[1]), min(splat(s[1]), p.z))};
    case CYLINDER: {
      // nearer to the lid or to the side, in units of the size
      Mask lid = s[1] - abs(p.z) < s[0] - sqrt(p.x * p.x + p.y * p.y);
      return {select(lid, zero, p.x), select(lid, zero, p.y), select(lid, p.z, zero)};
    }
    case BOX: {
      // the face that the point sticks out of most
      Float x = abs(p.x) - s[0], y = abs(p.y) - s[1], z = abs(p.z) - s[2];
      Mask face_x = (x >= y) & (x >= z), face_z = (z > x) & (z > y);
      return {select(face_x, p.x, zero), select(face_x | face_z, zero, p.y),
              select(face_z, p.z, zero)};
    }
    default:
      return {zero, zero, splat(1.0f)};
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
