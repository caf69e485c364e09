// The pyramid of a pinhole's rays through one pixel, which finds the triangles of a mesh that any
// of them can meet: so many rays are not worth a traversal each.
#pragma once

#include "render/geometry/camera.inl"
#include "render/geometry/intersect.inl"

namespace evs::EVS_NAMESPACE {
namespace {

struct PixelPyramid {
  V3 normal[4];  // of its sides, unit, inward
  RayCone cone;  // around it
};

EVS_INLINE V3 cross(V3 a, V3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// In: the pixel's column and row. There is room for the rounding of the rays.
inline PixelPyramid pixel_pyramid(const Frame& f, float column, float row) {
  const float room = 0.01f + 4e-6f * (f.fx > f.fy ? f.fx : f.fy);
  auto through = [&](float x, float y) {
    return normalized({(x - f.cx) / f.fx, (f.cy - y) / f.fy, -1.0f});
  };
  const float left = column - room, right = column + 1 + room, top = row - room,
              bottom = row + 1 + room;
  const V3 corner[4] = {through(left, top), through(left, bottom), through(right, bottom),
                        through(right, top)};
  PixelPyramid out;
  out.cone = {{0, 0, 0}, through(column + 0.5f, row + 0.5f), 0, T_INFINITY, 1, 0};
  float square = 0;
  for (int i = 0; i < 4; i++) {
    out.normal[i] = normalized(cross(corner[(i + 1) % 4], corner[i]));
    V3 apart = corner[i] - out.cone.axis;
    square = dot(apart, apart) > square ? dot(apart, apart) : square;
  }
  open_cone(out.cone, square);
  return out;
}

// The sides of a pyramid in a mesh's frame, over the lanes.
struct Sides {
  static constexpr int COUNT = LANES > 4 ? LANES : 4;
  V3 apex;
  float x[COUNT], y[COUNT], z[COUNT];

  EVS_INLINE Sides(const Geom& g, const PixelPyramid& pyramid) : apex(g.camera) {
    const float* r = g.rotation;
    for (int i = 0; i < COUNT; i++) {
      V3 n = pyramid.normal[i % 4];
      x[i] = r[0] * n.x + r[3] * n.y + r[6] * n.z;
      y[i] = r[1] * n.x + r[4] * n.y + r[7] * n.z;
      z[i] = r[2] * n.x + r[5] * n.y + r[8] * n.z;
    }
  }
  // Can a box lie in the pyramid, or a part of it?
  EVS_INLINE bool touch(const float* low, const float* high) const {
    V3 half = {0.5f * (high[0] - low[0]), 0.5f * (high[1] - low[1]), 0.5f * (high[2] - low[2])};
    V3 middle = {0.5f * (high[0] + low[0]) - apex.x, 0.5f * (high[1] + low[1]) - apex.y,
                 0.5f * (high[2] + low[2]) - apex.z};
    for (int i = 0; i < 4; i += LANES) {
      Float nx = load(x + i), ny = load(y + i), nz = load(z + i);
      Float reach = abs(nx) * half.x + abs(ny) * half.y + abs(nz) * half.z;
      if (any(nx * middle.x + ny * middle.y + nz * middle.z + reach < 0.0f)) return false;
    }
    return true;
  }
  EVS_INLINE bool touch(const Triangle& t) const {
    V3 a = t.a - apex, b = t.b - apex, c = t.c - apex;
    // it is seen from behind
    if (dot(a, t.normal) > 1e-5f * length_bound(a) * length_bound(t.normal)) return false;
    for (int i = 0; i < 4; i += LANES) {
      Float nx = load(x + i), ny = load(y + i), nz = load(z + i);
      Mask outside = (nx * a.x + ny * a.y + nz * a.z < 0.0f) &
                     (nx * b.x + ny * b.y + nz * b.z < 0.0f) &
                     (nx * c.x + ny * c.y + nz * c.z < 0.0f);
      if (any(outside)) return false;
    }
    return true;
  }
};

// List the triangles of a geom's mesh whose front rays in the pyramid can meet. Returns false where
// there is no room for all.
inline bool list_triangles(const Mesh& mesh, const Geom& g, const PixelPyramid& pyramid,
                           TriangleList& out) {
  if (mesh.node_count == 0) return true;
  const Sides sides(g, pyramid);
  int stack[MAX_STACK], top = 0;
  stack[top++] = 0;
  while (top) {
    const Node& n = mesh.nodes[stack[--top]];
    for (int c = 0; c < 2; c++) {
      if (!sides.touch(n.low[c], n.high[c])) continue;
      if (n.child[c] >= 0) {
        stack[top++] = n.child[c];
        continue;
      }
      for (int i = ~n.child[c], end = i + n.count[c]; i < end; i++) {
        if (!sides.touch(mesh.triangles[i])) continue;
        if (out.count == TriangleList::ROOM) return false;
        out.index[out.count++] = i;
      }
    }
  }
  return true;
}

// Find the nearest hits of the rays of a pixel, which lie in a pyramid, beyond the near plane.
template <int COUNT>
void intersect_pixel(const Frame& f, const PixelPyramid& pyramid, const Rays (&rays)[COUNT],
                     Hit (&hits)[COUNT]) {
  Passed passed[COUNT];
  for (int i = 0; i < COUNT; i++) {
    passed[i] = from(near_distance(f, rays[i].direction));
    hits[i] = no_hit(mask_from_bits(ALL_LANES));
  }
  auto visit = [&](int index) {
    const Geom& g = f.geoms[index];
    TriangleList near;
    bool listed = g.mesh >= 0 && list_triangles(f.meshes[g.mesh], g, pyramid, near);
    if (listed && near.count == 0) return false;
    for (int i = 0; i < COUNT; i++)
      intersect_geom(f, index, rays[i], passed[i], false, hits[i], listed ? &near : nullptr);
    return false;
  };
  for (int k = 0, end = candidates_end(f, pyramid.cone); k < end; k += LANES) {
    for (unsigned near = candidates(f, k, end, pyramid.cone); near; near &= near - 1)
      visit(k + first_lane(near));
  }
  if (f.bvh.top == 0 || !cone_may_touch(f.finite_bounds, pyramid.cone)) return;
  GeomSet found;
  find_geoms(f.bvh, pyramid.cone, found);
  found.visit(visit);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
