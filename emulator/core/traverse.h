// Packets through a mesh's BVH. Rays are in the mesh's frame.

struct MeshRays {
  Vec o, d, inverse, offset;  // offset = o / d: one multiply-subtract a slab
};

EVS_INLINE MeshRays mesh_rays(Vec o, Vec d) {
  Vec inverse = {safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z)};
  return {o, d, inverse, {o.x * inverse.x, o.y * inverse.y, o.z * inverse.z}};
}

// Lanes that cross the box of child `c` before `best`; `near` is where.
EVS_INLINE Mask cross_box(const Node& n, int c, const MeshRays& r, Float best, Float& near) {
  Float ax = r.inverse.x * n.low[c][0] - r.offset.x, bx = r.inverse.x * n.high[c][0] - r.offset.x;
  Float ay = r.inverse.y * n.low[c][1] - r.offset.y, by = r.inverse.y * n.high[c][1] - r.offset.y;
  Float az = r.inverse.z * n.low[c][2] - r.offset.z, bz = r.inverse.z * n.high[c][2] - r.offset.z;
  near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), splat(0.0f)));
  Float far = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), best));
  // rounding may put a box's faces in the wrong order by an ulp or two: let such a ray in
  return near <= far * 1.000001f;
}

// Moeller & Trumbore (1997). Front faces, and back faces too if `both`; the edges are closed.
EVS_INLINE Mask cross_triangle(const Triangle& t, const MeshRays& r, Float best, bool both,
                               Float& distance, Float& u, Float& v) {
  Vec p = {r.d.y * t.e2.z - r.d.z * t.e2.y, r.d.z * t.e2.x - r.d.x * t.e2.z,
           r.d.x * t.e2.y - r.d.y * t.e2.x};
  Float determinant = p.x * t.e1.x + p.y * t.e1.y + p.z * t.e1.z;
  Float inverse = 1.0f / determinant;  // inf or NaN for a degenerate triangle: no comparison holds
  Vec s = {r.o.x - t.p.x, r.o.y - t.p.y, r.o.z - t.p.z};
  u = dot(s, p) * inverse;
  Vec q = {s.y * t.e1.z - s.z * t.e1.y, s.z * t.e1.x - s.x * t.e1.z, s.x * t.e1.y - s.y * t.e1.x};
  v = dot(r.d, q) * inverse;
  distance = (q.x * t.e2.x + q.y * t.e2.y + q.z * t.e2.z) * inverse;
  Mask hit = (u >= 0.0f) & (v >= 0.0f) & (u + v <= 1.0f) & (distance > 0.0f) & (distance < best);
  return both ? hit : hit & (determinant > 0.0f);
}

constexpr int STACK = 96;  // the builder keeps trees below this depth

// Nearest front face before `best`. Out: lanes that hit; best, triangle, u, v of those lanes.
inline Mask enter_mesh(const Mesh& mesh, const MeshRays& r, Float& best, Int& triangle, Float& u,
                       Float& v) {
  Mask any_hit = mask_of(0);
  if (mesh.node_count == 0) return any_hit;
  int stack[STACK], top = 0;
  stack[top++] = 0;
  while (top) {
    const Node& n = mesh.nodes[stack[--top]];
    Float near[2];
    unsigned lanes[2];
    for (int c = 0; c < 2; c++) lanes[c] = bits(cross_box(n, c, r, best, near[c]));
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
        Mask hit = cross_triangle(mesh.triangles[i], r, best, false, distance, a, b);
        if (!any(hit)) continue;
        best = select(hit, distance, best);
        triangle = select(hit, splat(i), triangle);
        u = select(hit, a, u);
        v = select(hit, b, v);
        any_hit = any_hit | hit;
      }
    }
    while (inners) stack[top++] = inner[--inners];
  }
  return any_hit;
}

// Lanes of `wanted` that hit anything, front or back, before `limit`.
inline Mask blocked_by_mesh(const Mesh& mesh, const MeshRays& r, Float limit, Mask wanted) {
  Mask blocked = mask_of(0);
  if (mesh.node_count == 0) return blocked;
  int stack[STACK], top = 0;
  stack[top++] = 0;
  limit = select(wanted, limit, splat(-1.0f));
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
        if (!any(hit)) continue;
        blocked = blocked | hit;
        limit = select(hit, splat(-1.0f), limit);
        if (!any(wanted & ~blocked)) return blocked;
      }
    }
  }
  return blocked;
}
