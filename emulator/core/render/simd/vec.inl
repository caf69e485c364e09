// Vectors of lanes: points, directions and rotations of a packet, and the scalar V3 beside them.
#pragma once

#include "base/simd_math.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct Vec {
  Float x, y, z;
};

EVS_INLINE Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
EVS_INLINE Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
EVS_INLINE Vec operator*(Vec a, Float s) { return {a.x * s, a.y * s, a.z * s}; }
EVS_INLINE Float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
EVS_INLINE Vec splat(V3 a) { return {splat(a.x), splat(a.y), splat(a.z)}; }
EVS_INLINE Vec select(Mask m, Vec a, Vec b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}
EVS_INLINE Vec normalize(Vec a) { return a * (1.0f / sqrt(max(dot(a, a), splat(1e-30f)))); }

EVS_INLINE Vec to_local(const float* r, Vec v) {
  return {v.x * r[0] + v.y * r[3] + v.z * r[6], v.x * r[1] + v.y * r[4] + v.z * r[7],
          v.x * r[2] + v.y * r[5] + v.z * r[8]};
}
EVS_INLINE Vec to_camera(const float* r, Vec v) {
  return {v.x * r[0] + v.y * r[1] + v.z * r[2], v.x * r[3] + v.y * r[4] + v.z * r[5],
          v.x * r[6] + v.y * r[7] + v.z * r[8]};
}

EVS_INLINE Vec cross(Vec a, Vec b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

EVS_INLINE float dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
EVS_INLINE V3 operator-(V3 a, V3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
EVS_INLINE V3 scaled(V3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
EVS_INLINE V3 normalized(V3 a) {
  float n = dot(a, a);
  return n > 0 ? scaled(a, 1.0f / __builtin_sqrtf(n)) : V3{0, 0, -1};
}

struct Point2 {
  Float x, y;
};

}  // namespace
}  // namespace evs::EVS_NAMESPACE
