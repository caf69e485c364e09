// Ray intersection with the analytic shapes, in the geom's frame, with unit directions.
//
// Only front-facing hits with t > 0 count: a camera inside a shape sees through it, as in MuJoCo's
// viewer. A miss returns T_INFINITY. A NaN is a miss.
#pragma once

#include "render/geometry/rays.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Float intersect_plane(const float* size, Vec o, Vec d) {
  Float t = o.z / -d.z;  // undefined where there is no hit
  Mask hit = (d.z < 0.0f) & (o.z > 0.0f);
  if (size[0] > 0) hit = hit & (abs(o.x + d.x * t) <= size[0]);
  if (size[1] > 0) hit = hit & (abs(o.y + d.y * t) <= size[1]);
  return select(hit, t, splat(T_INFINITY));
}

EVS_INLINE Float intersect_sphere(const float* size, Vec o, Vec d) {
  // start at the foot of the perpendicular: |o|^2 and r^2 do not cancel
  Float b = dot(o, d);
  Vec foot = o - d * b;
  Float discriminant = size[0] * size[0] - dot(foot, foot);
  Float t = -b - sqrt(max(discriminant, splat(0.0f)));
  return select((discriminant > 0.0f) & (t > 0.0f), t, splat(T_INFINITY));
}

EVS_INLINE Float intersect_ellipsoid(const float* size, Vec o, Vec d) {
  Vec p = {o.x * (1.0f / size[0]), o.y * (1.0f / size[1]), o.z * (1.0f / size[2])};
  Vec q = {d.x * (1.0f / size[0]), d.y * (1.0f / size[1]), d.z * (1.0f / size[2])};
  Float inverse = 1.0f / dot(q, q);
  Float b = dot(p, q) * inverse;
  Vec foot = p - q * b;
  Float discriminant = 1.0f - dot(foot, foot);
  Float t = -b - sqrt(max(discriminant, splat(0.0f)) * inverse);
  return select((discriminant > 0.0f) & (t > 0.0f), t, splat(T_INFINITY));
}

// Intersect the infinite cylinder around z. Out: where the ray enters and leaves it. False: a miss.
EVS_INLINE Mask intersect_infinite_cylinder(float radius, Vec o, Vec d, Float& enter,
                                            Float& leave) {
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

EVS_INLINE Float intersect_capsule(const float* size, Vec o, Vec d) {
  float radius = size[0], half = size[1];
  Float side, leave;
  Mask crossed = intersect_infinite_cylinder(radius, o, d, side, leave);
  if (!any(crossed)) return splat(T_INFINITY);
  // beyond the barrel the sphere of that cap decides
  Float z = o.z + d.z * side;
  Mask barrel = (abs(z) <= half) & (side > 0.0f);
  Vec p = {o.x, o.y, o.z - select(z < -half, splat(-half), splat(half))};
  Float cap = intersect_sphere(size, p, d);
  return select(crossed, select(abs(z) <= half, select(barrel, side, splat(T_INFINITY)), cap),
                splat(T_INFINITY));
}

EVS_INLINE Float intersect_cylinder(const float* size, Vec o, Vec d) {
  Float side, leave;
  Mask crossed = intersect_infinite_cylinder(size[0], o, d, side, leave);
  if (!any(crossed)) return splat(T_INFINITY);
  Float inverse = safe_inverse(d.z);
  Float a = (-size[1] - o.z) * inverse, b = (size[1] - o.z) * inverse;
  Float t_near = max(side, min(a, b)), t_far = min(leave, max(a, b));
  return select(crossed & (t_near <= t_far) & (t_near > 0.0f), t_near, splat(T_INFINITY));
}

EVS_INLINE Float intersect_box(const float* size, Vec o, Vec d) {
  Vec inverse = {safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z)};
  Vec reach = {abs(inverse.x) * size[0], abs(inverse.y) * size[1], abs(inverse.z) * size[2]};
  Vec middle = {-(o.x * inverse.x), -(o.y * inverse.y), -(o.z * inverse.z)};
  Float t_near = max(max(middle.x - reach.x, middle.y - reach.y), middle.z - reach.z);
  Float t_far = min(min(middle.x + reach.x, middle.y + reach.y), middle.z + reach.z);
  return select((t_near <= t_far) & (t_near > 0.0f), t_near, splat(T_INFINITY));
}

EVS_INLINE Float intersect_shape(const Geom& g, Vec o, Vec d) {
  switch (g.shape) {
    case PLANE:
      return intersect_plane(g.size, o, d);
    case SPHERE:
      return intersect_sphere(g.size, o, d);
    case CAPSULE:
      return intersect_capsule(g.size, o, d);
    case ELLIPSOID:
      return intersect_ellipsoid(g.size, o, d);
    case CYLINDER:
      return intersect_cylinder(g.size, o, d);
    case BOX:
      return intersect_box(g.size, o, d);
    default:
      return splat(T_INFINITY);
  }
}

// Return the outward normal of a shape at a local surface point, not normalised.
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
      // choose the lid or the side, whichever is nearer
      Mask lid = s[1] - abs(p.z) < s[0] - sqrt(p.x * p.x + p.y * p.y);
      return {select(lid, zero, p.x), select(lid, zero, p.y), select(lid, p.z, zero)};
    }
    case BOX: {
      // choose the face that is nearest to the point
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
}  // namespace evs::EVS_NAMESPACE
