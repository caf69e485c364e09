// Packets through a mesh's BVH. Rays are in the mesh's frame.
#pragma once

#include "geometry/rays.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

struct MeshRays {
  Vec o, d, inverse;
  Float skipped;  // how far the rays were moved along themselves
};

// Rays that come from afar start where they reach the ball around the mesh: the rounding of what
// follows is that of the mesh's size, not that of its distance.
EVS_INLINE MeshRays mesh_rays(const Mesh& mesh, Vec o, Vec d) {
  Vec inverse = {safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z)};
  Float along = dot(splat(mesh.center) - o, d);
  Float skipped = max(along * 0.999999f - mesh.radius * 1.001f, splat(0.0f));
  return {o + d * skipped, d, inverse, skipped};
}

// Lanes that cross the box of child `c` before `best`; `near` is where.
EVS_INLINE Mask cross_box(const Node& n, int c, const MeshRays& r, Float best, Float& near) {
  Float ax = (splat(n.low[c][0]) - r.o.x) * r.inverse.x;
  Float bx = (splat(n.high[c][0]) - r.o.x) * r.inverse.x;
  Float ay = (splat(n.low[c][1]) - r.o.y) * r.inverse.y;
  Float by = (splat(n.high[c][1]) - r.o.y) * r.inverse.y;
  Float az = (splat(n.low[c][2]) - r.o.z) * r.inverse.z;
  Float bz = (splat(n.high[c][2]) - r.o.z) * r.inverse.z;
  near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), splat(0.0f)));
  Float far = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), best));
  // rounding may put a box's faces in the wrong order by an ulp or two: let such a ray in
  return near <= far * 1.000001f;
}

// Front faces, and back faces too if `both`. Edges are closed and watertight: two triangles that
// share an edge compute the same volume over it, but for the sign, so no ray passes between them.
EVS_INLINE Mask cross_triangle(const Triangle& t, const MeshRays& r, Float best, bool both,
                               Float& distance, Float& u, Float& v) {
  Vec a = splat(t.a) - r.o, b = splat(t.b) - r.o, c = splat(t.c) - r.o;
  // volumes over the edges: all of one sign where the ray passes inside
  Float wa = dot(r.d, cross(b, c)), wb = dot(r.d, cross(c, a)), wc = dot(r.d, cross(a, b));
  Mask front = (wa <= 0.0f) & (wb <= 0.0f) & (wc <= 0.0f);
  if (!both && !any(front)) return front;
  Vec normal = splat(t.normal);
  Float along = dot(r.d, normal);
  distance = dot(a, normal) / along;  // inf or NaN for a degenerate triangle: no comparison holds
  Mask ahead = (distance > 0.0f) & (distance <= best);
  if (both) return ahead & (front | ((wa >= 0.0f) & (wb >= 0.0f) & (wc >= 0.0f)));
  // -1e-30: a triangle so small that its volumes vanish is all corner
  Float inverse = 1.0f / min(wa + wb + wc, splat(-1e-30f));
  u = wb * inverse;
  v = wc * inverse;
  return ahead & front & (along < 0.0f);
}

constexpr int STACK = 96;  // the builder keeps trees below this depth

// Nearest front face after `beyond` and before `best`. Out: lanes that hit; best, triangle, u, v of
// those lanes.
inline Mask enter_mesh(const Mesh& mesh, const MeshRays& r, Float beyond, Float& best,
                       Int& triangle, Float& u, Float& v) {
  Mask any_hit = mask_of(0);
  if (mesh.node_count == 0) return any_hit;
  int stack[STACK], top = 0;
  stack[top++] = 0;
  Float nearest = best - r.skipped;
  while (top) {
    const Node& n = mesh.nodes[stack[--top]];
    Float near[2];
    unsigned lanes[2];
    for (int c = 0; c < 2; c++) lanes[c] = bits(cross_box(n, c, r, nearest, near[c]));
    // nearer child first, judged by a lane that enters both
    int first = 0;
    if (lanes[0] & lanes[1]) {
      int i = first_lane(lanes[0] & lanes[1]);
      first = lane(near[1], i) < lane(near[0], i);
    }
    int inner[2], inners = 0;
    for (int k = 0; k < 2; k++) {
      int c = k ^ first;
      if (!lanes[c]) continue;
      if (n.child[c] >= 0) {
        inner[inners++] = n.child[c];
        continue;
      }
      for (int i = ~n.child[c], end = i + n.count[c]; i < end; i++) {
        Float distance, a, b;
        Mask hit = cross_triangle(mesh.triangles[i], r, nearest, false, distance, a, b);
        hit = hit & (distance + r.skipped > beyond);
        if (!any(hit)) continue;
        // of two at one distance the first counts, whichever way the tree was walked
        hit = hit & ((distance < nearest) | (any_hit & (splat(i) < triangle)));
        nearest = select(hit, distance, nearest);
        triangle = select(hit, splat(i), triangle);
        u = select(hit, a, u);
        v = select(hit, b, v);
        any_hit = any_hit | hit;
      }
    }
    while (inners) stack[top++] = inner[--inners];
  }
  best = select(any_hit, nearest + r.skipped, best);
  return any_hit;
}

// Lanes of `wanted` that hit anything, front or back, before `limit`.
inline Mask blocked_by_mesh(const Mesh& mesh, const MeshRays& r, Float limit, Mask wanted) {
  Mask blocked = mask_of(0);
  if (mesh.node_count == 0) return blocked;
  int stack[STACK], top = 0;
  stack[top++] = 0;
  limit = select(wanted, limit - r.skipped, splat(-1.0f));
  while (top) {
    const Node& n = mesh.nodes[stack[--top]];
    for (int c = 1; c >= 0; c--) {
      Float near;
      if (!any(cross_box(n, c, r, limit, near))) continue;
      if (n.child[c] >= 0) {
        stack[top++] = n.child[c];
        continue;
      }
      for (int i = ~n.child[c], end = i + n.count[c]; i < end; i++) {
        Float distance, a, b;
        Mask hit = cross_triangle(mesh.triangles[i], r, limit, true, distance, a, b);
        hit = hit & (distance < limit);
        if (!any(hit)) continue;
        blocked = blocked | hit;
        limit = select(hit, splat(-1.0f), limit);
        if (!any(wanted & ~blocked)) return blocked;
      }
    }
  }
  return blocked;
}

}  // namespace
}  // namespace evs::EVS_SPACE
