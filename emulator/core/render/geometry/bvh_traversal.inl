// Traversal of a mesh's BVH by a packet of rays, in the mesh's frame.
#pragma once

#include <cmath>

#include "render/geometry/rays.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct MeshRays {
  Vec o, d, inverse;
  Float t_offset;  // t of the camera's ray at this origin
};

// Transform rays for one mesh. Rays from far away start at the mesh's bounding sphere, so rounding
// errors are proportional to the mesh's size and not to its distance.
EVS_INLINE MeshRays mesh_rays(const Mesh& mesh, Vec o, Vec d) {
  Vec inverse = {safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z)};
  Float along = dot(splat(mesh.center) - o, d);
  Float t_offset = max(along * 0.999999f - mesh.radius * 1.001f, splat(0.0f));
  return {o + d * t_offset, d, inverse, t_offset};
}

// Slab test: lanes that enter the box of child `c` before `t_max`. Out: t_near.
EVS_INLINE Mask intersect_box(const Node& n, int c, const MeshRays& r, Float t_max, Float& t_near) {
  Float ax = (splat(n.low[c][0]) - r.o.x) * r.inverse.x;
  Float bx = (splat(n.high[c][0]) - r.o.x) * r.inverse.x;
  Float ay = (splat(n.low[c][1]) - r.o.y) * r.inverse.y;
  Float by = (splat(n.high[c][1]) - r.o.y) * r.inverse.y;
  Float az = (splat(n.low[c][2]) - r.o.z) * r.inverse.z;
  Float bz = (splat(n.high[c][2]) - r.o.z) * r.inverse.z;
  t_near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), splat(0.0f)));
  Float t_far = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), t_max));
  // let a ray in when rounding puts the slabs in the wrong order by an ulp or two
  return t_near <= t_far * 1.000001f;
}

// Watertight ray-triangle test on front faces, and on back faces too if `both`. Edges are closed:
// two triangles that share an edge compute the same signed volume over it, so no ray passes between
// them.
EVS_INLINE Mask intersect_triangle(const Triangle& t, const MeshRays& r, Float t_max, bool both,
                                   Float& distance, Float& u, Float& v) {
  Vec a = splat(t.a) - r.o, b = splat(t.b) - r.o, c = splat(t.c) - r.o;
  // signed volumes over the three edges: all have one sign where the ray passes inside
  Float wa = dot(r.d, cross(b, c)), wb = dot(r.d, cross(c, a)), wc = dot(r.d, cross(a, b));
  Mask front = (wa <= 0.0f) & (wb <= 0.0f) & (wc <= 0.0f);
  if (!both && !any(front)) return front;
  Vec normal = splat(t.normal);
  Float along = dot(r.d, normal);
  distance =
      dot(a, normal) / along;  // inf or NaN for a degenerate triangle: every comparison fails
  Mask ahead = (distance > 0.0f) & (distance <= t_max);
  if (both) return ahead & (front | ((wa >= 0.0f) & (wb >= 0.0f) & (wc >= 0.0f)));
  // -1e-30: a triangle so small that its volumes underflow has no interior
  Float inverse = 1.0f / min(wa + wb + wc, splat(-1e-30f));
  u = wb * inverse;
  v = wc * inverse;
  return ahead & front & (along < 0.0f);
}

// The nearest front face that rays have met.
struct NearestTriangle {
  Mask any_hit = mask_from_bits(0);
  Float nearest, u, v;
  Int triangle;

  EVS_INLINE NearestTriangle(const MeshRays& r, Float t_max)
      : nearest(t_max - r.t_offset), u(splat(0.0f)), v(u), triangle(splat(0)) {}

  EVS_INLINE void intersect(const Triangle& t, int index, const MeshRays& r, Float t_min) {
    Float distance, a, b;
    Mask hit = intersect_triangle(t, r, nearest, false, distance, a, b);
    hit = hit & (distance + r.t_offset > t_min);
    if (!any(hit)) return;
    // of two hits at one distance keep the first triangle, in any order of traversal
    hit = hit & ((distance < nearest) | (any_hit & (splat(index) < triangle)));
    nearest = select(hit, distance, nearest);
    triangle = select(hit, splat(index), triangle);
    u = select(hit, a, u);
    v = select(hit, b, v);
    any_hit = any_hit | hit;
  }
  EVS_INLINE Mask found(const MeshRays& r, Float& t_max, Int& its_triangle, Float& its_u,
                        Float& its_v) const {
    t_max = select(any_hit, nearest + r.t_offset, t_max);
    its_triangle = select(any_hit, triangle, its_triangle);
    its_u = select(any_hit, u, its_u);
    its_v = select(any_hit, v, its_v);
    return any_hit;
  }
};

constexpr int MAX_STACK = 96;  // the builder keeps every BVH shallower than this

// Find the nearest front face with t_min < t < t_max. Out: the lanes that hit; t_max, triangle, u
// and v of those lanes.
EVS_OUTLINE_IN_PATHS inline Mask intersect_mesh(const Mesh& mesh, const MeshRays& r, Float t_min,
                                                Float& t_max, Int& triangle, Float& u, Float& v) {
  NearestTriangle nearer(r, t_max);
  if (mesh.node_count == 0) return nearer.any_hit;
  int stack[MAX_STACK], top = 0;
  stack[top++] = 0;
  while (top) {
    // intersect the boxes of both children
    const Node& n = mesh.nodes[stack[--top]];
    Float t_near[2];
    unsigned lanes[2];
    for (int c = 0; c < 2; c++)
      lanes[c] = to_bits(intersect_box(n, c, r, nearer.nearest, t_near[c]));
    // visit the nearer child first, as one lane that enters both sees it
    int first = 0;
    if (lanes[0] & lanes[1]) {
      int i = first_lane(lanes[0] & lanes[1]);
      first = lane(t_near[1], i) < lane(t_near[0], i);
    }
    // intersect the triangles of leaves, and push inner nodes, the nearer one last
    int inner[2], inners = 0;
    for (int k = 0; k < 2; k++) {
      int c = k ^ first;
      if (!lanes[c]) continue;
      if (n.child[c] >= 0) {
        inner[inners++] = n.child[c];
        continue;
      }
      for (int i = ~n.child[c], end = i + n.count[c]; i < end; i++) {
        nearer.intersect(mesh.triangles[i], i, r, t_min);
      }
    }
    while (inners) stack[top++] = inner[--inners];
  }
  return nearer.found(r, t_max, triangle, u, v);
}

// Triangles of a mesh.
struct TriangleList {
  static constexpr int ROOM = 256;
  int count = 0;
  int index[ROOM];
};

// As `intersect_mesh`, among listed triangles.
inline Mask intersect_listed(const Mesh& mesh, const TriangleList& list, const MeshRays& r,
                             Float t_min, Float& t_max, Int& triangle, Float& u, Float& v) {
  NearestTriangle nearer(r, t_max);
  for (int i = 0; i < list.count; i++)
    nearer.intersect(mesh.triangles[list.index[i]], list.index[i], r, t_min);
  return nearer.found(r, t_max, triangle, u, v);
}

constexpr float LOCAL_ROUNDING = 4e-7f;  // of a ray's origin in the mesh's frame, as a share of it

// Between a vector's length and 1.74 of it.
EVS_INLINE Float length_bound(Vec v) { return abs(v.x) + abs(v.y) + abs(v.z); }
EVS_INLINE float length_bound(V3 v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

// The lanes of `hit` whose origin is not in the plane of the triangle. A shadow ray begins on a
// surface; a face in whose plane it begins coincides with that surface.
EVS_INLINE Mask begins_apart(const Triangle& t, const MeshRays& r, Vec origin, Float distance,
                             Mask hit) {
  Float height = distance * dot(r.d, splat(t.normal));  // times the length of the normal
  Float rounding = length_bound(origin) * COINCIDENT + length_bound(r.o) * LOCAL_ROUNDING;
  return hit & (abs(height) > rounding * length_bound(t.normal));
}

// Find the lanes of `active` that hit any face, front or back, before `t_max`. `origin`: of the
// rays, in the camera's frame.
EVS_OUTLINE_IN_PATHS inline Mask occluded_mesh(const Mesh& mesh, const MeshRays& r, Vec origin,
                                               Float t_max, Mask active) {
  Mask blocked = mask_from_bits(0);
  if (mesh.node_count == 0) return blocked;
  int stack[MAX_STACK], top = 0;
  stack[top++] = 0;
  // -1: lanes that are done enter no box
  t_max = select(active, t_max - r.t_offset, splat(-1.0f));
  while (top) {
    const Node& n = mesh.nodes[stack[--top]];
    for (int c = 1; c >= 0; c--) {
      Float t_near;
      if (!any(intersect_box(n, c, r, t_max, t_near))) continue;
      if (n.child[c] >= 0) {
        stack[top++] = n.child[c];
        continue;
      }
      // stop as soon as every lane is blocked
      for (int i = ~n.child[c], end = i + n.count[c]; i < end; i++) {
        Float distance, a, b;
        Mask hit = intersect_triangle(mesh.triangles[i], r, t_max, true, distance, a, b);
        hit = hit & (distance < t_max);
        if (!any(hit)) continue;
        hit = begins_apart(mesh.triangles[i], r, origin, distance, hit);
        blocked = blocked | hit;
        t_max = select(hit, splat(-1.0f), t_max);
        if (!any(active & ~blocked)) return blocked;
      }
    }
  }
  return blocked;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
