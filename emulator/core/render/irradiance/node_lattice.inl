// The lattice of the irradiance cache, and reading it: irradiance is interpolated between the four
// nodes of a cell, and where the camera's distance calls for it between two levels.
//
// The lattice lies in the geom's own frame, so it moves with the geom. Its spacing halves from
// level to level, and the level follows from the distance from the camera. Shapes project it from
// their bounding box: round ones from their centre, so that cells meet at the edges of the box.
// Meshes project it along the axis that their normal is nearest to.
#pragma once

#include "render/geometry/intersect.inl"
#include "render/shading/surface_interaction.inl"
#include "scene/irradiance.h"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr float BLEND_FROM = 1.75f;  // of the distances of a level, 1 ... 2

// Points on the lattice of one geom.
struct LatticePoint {
  Int face;        // 2 axis + 1 on the negative side
  Vec coordinate;  // the one along the face's axis is whole
};

EVS_INLINE Int face_of(Vec v, Mask& on_x, Mask& on_z) {
  Float x = abs(v.x), y = abs(v.y), z = abs(v.z);
  on_x = (x >= y) & (x >= z);
  on_z = ~on_x & (z > y);
  Float along = select(on_x, v.x, select(on_z, v.z, v.y));
  Int axis = select(on_x, splat(0), select(on_z, splat(4), splat(2)));
  return axis + select(along < 0.0f, splat(1), splat(0));
}

inline LatticePoint lattice_point(const Geom& g, const NodeLattice& lattice, Vec p, Vec n) {
  LatticePoint out;
  Float zero = splat(0.0f), one = splat(1.0f);
  float inverse = 1.0f / lattice.spacing;
  Mask on_x, on_z;
  if (g.shape == PLANE) {
    out.face = splat(4);
    out.coordinate = {p.x * inverse - LATTICE_SHIFT, p.y * inverse - LATTICE_SHIFT, zero};
    return out;
  }
  if (g.shape == MESH || g.shape == HFIELD) {
    out.face = face_of(n, on_x, on_z);
    // whole along the normal
    auto place = [inverse](Float x, Mask along) {
      x = x * inverse;
      return select(along, floor(x * (1 / SHEET)), x - LATTICE_SHIFT);
    };
    out.coordinate = {place(p.x, on_x), place(p.y, ~on_x & ~on_z), place(p.z, on_z)};
    return out;
  }
  const float* half = lattice.half;
  Vec q = {p.x * (1.0f / half[0]), p.y * (1.0f / half[1]), p.z * (1.0f / half[2])};
  if (g.shape == CYLINDER) {
    // the side is a square ring, the lids are squares
    Mask lid = half[2] - abs(p.z) < half[0] - sqrt(p.x * p.x + p.y * p.y);
    Float ring = max(max(abs(q.x), abs(q.y)), splat(1e-6f));
    Int side = face_of({q.x, q.y, zero}, on_x, on_z);
    on_x = on_x & ~lid;
    on_z = lid;
    out.face = select(lid, select(q.z < 0.0f, splat(5), splat(4)), side);
    q = {select(lid, q.x, q.x / ring), select(lid, q.y, q.y / ring), q.z};
  } else {
    out.face = face_of(q, on_x, on_z);
    if (is_smooth(g.shape)) {
      Float largest = max(max(abs(q.x), abs(q.y)), max(abs(q.z), splat(1e-6f)));
      q = {q.x / largest, q.y / largest, q.z / largest};
    }
  }
  auto place = [&](Float x, Mask across, float count) {
    x = select(across, select(x < 0.0f, -one, one), min(max(x, -one), one));
    return (x + 1.0f) * (0.5f * count);
  };
  out.coordinate = {place(q.x, on_x, lattice.count[0]), place(q.y, ~on_x & ~on_z, lattice.count[1]),
                    place(q.z, on_z, lattice.count[2])};
  return out;
}

// The face of a node's key: round shapes share nodes between faces.
EVS_INLINE int key_face(int shape, int face) {
  if (is_smooth(shape)) return 0;
  return shape == CYLINDER && face < 4 ? 6 : face;
}

// Irradiance over pi: by colour, and the luminance that the surface reflects of it.
struct Received {
  Float colour[3], luminance;
};

// Of the hits of `lanes`, the one that comes first in an order that does not depend on the packet.
template <class To>
void first_hit(Vec p, Vec n, unsigned lanes, To& to) {
  for (bool any_yet = false; lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    To other = to;
    const float hit[6] = {lane(p.x, i), lane(p.y, i), lane(p.z, i),
                          lane(n.x, i), lane(n.y, i), lane(n.z, i)};
    __builtin_memcpy(other.point, hit, sizeof other.point);
    __builtin_memcpy(other.normal, hit + 3, sizeof other.normal);
    if (!any_yet || is_before(other, to)) to = other;
    any_yet = true;
  }
}

// The cells around hits: their nodes, and the place between these.
struct CellLanes {
  Int node[4];
  Float x, y;
};

// Note that this pass reads a node.
EVS_INLINE void mark_node(const IrradianceView& cache, int node) {
  uint8_t used = __atomic_load_n(cache.used + node, __ATOMIC_RELAXED);
  if (!(used & cache.pass))
    __atomic_store_n(cache.used + node, used | cache.pass, __ATOMIC_RELAXED);
}

// Find the nodes of a cell, or request those that are missing for the hits of `lanes`, one of which
// asks. Returns whether all are there.
inline bool find_cell(const IrradianceView& cache, NodeRequests& requests, int shape,
                      const NodeKey& cell, Vec p, Vec n, unsigned lanes, CellNodes& found) {
  found.key = cell;
  found.passes = cache.pass;
  NodeKey first = cell;
  first.face = key_face(shape, cell.face);
  int u = cell.face < 2 ? 1 : 0, v = cell.face < 4 ? 2 : 1;
  bool complete = true;
  for (int corner = 0; corner < 4; corner++) {
    NodeKey node = first;
    (u == 0 ? node.x : node.y) += corner & 1;
    (v == 2 ? node.z : node.y) += corner >> 1;
    int k = found.node[corner] = find_node(cache.slots, cache.mask, hash_of(node));
    if (k >= 0) {
      mark_node(cache, k);
      continue;
    }
    complete = requests.complete = false;
    NodeRequest& request = requests.next_request();
    request = {node, {0, 0, 0}, {0, 0, 0}};
    first_hit(p, n, lanes, request);
  }
  return complete;
}

// Find the cells of one level in which the lanes `here` of one geom lie. Other lanes are left as
// they are.
inline void find_cells(const IrradianceView& cache, NodeRequests& requests, const Geom& g, int geom,
                       int level, Vec p, Vec n, Mask here, CellLanes& out) {
  NodeLattice lattice = node_lattice(g, level);
  LatticePoint at = lattice_point(g, lattice, p, n);
  bool bounded = g.shape != PLANE && g.shape != MESH && g.shape != HFIELD;
  // the cell's first node, and the place in the cell
  Int axis = shift_right<1>(at.face);
  Float fraction[3];
  const Float coordinate[3] = {at.coordinate.x, at.coordinate.y, at.coordinate.z};
  Int place[3];
  for (int a = 0; a < 3; a++) {
    Float c = min(max(coordinate[a], splat(-1e9f)), splat(1e9f));
    Float base = floor(c);
    if (bounded) base = min(base, splat(lattice.count[a] - 1.0f));
    base = select(axis == splat(a), c, base);
    fraction[a] = c - base;
    place[a] = truncate(base);
  }
  Mask on_x = axis == splat(0), on_z = axis == splat(2);
  out.x = select(here, select(on_x, fraction[1], fraction[0]), out.x);
  out.y = select(here, select(on_z, fraction[1], fraction[2]), out.y);
  alignas(64) int faces[LANES], places[3][LANES];
  store(faces, at.face);
  for (int a = 0; a < 3; a++) store(places[a], place[a]);
  // go cell by cell
  for (unsigned left = to_bits(here); left;) {
    int i = first_lane(left);
    NodeKey key = {geom, level, faces[i], places[0][i], places[1][i], places[2][i]};
    Mask cell = (at.face == splat(key.face)) & (place[0] == splat(key.x)) &
                (place[1] == splat(key.y)) & (place[2] == splat(key.z)) & mask_from_bits(left);
    left &= ~to_bits(cell);
    CellNodes& known = requests.cell_of(key);
    if (__builtin_memcmp(&known.key, &key, sizeof key) != 0) {
      if (!find_cell(cache, requests, g.shape, key, p, n, to_bits(cell), known)) {
        known.key.geom = -1;
        continue;
      }
    } else if (!(known.passes & cache.pass)) {
      for (int node : known.node) mark_node(cache, node);
      known.passes |= cache.pass;
    }
    for (int k = 0; k < 4; k++) out.node[k] = select(cell, splat(known.node[k]), out.node[k]);
    if (!cache.readers) continue;
    CellReader& reader = requests.next_reader();
    __builtin_memcpy(reader.node, known.node, sizeof reader.node);
    first_hit(p, n, to_bits(cell), reader);
  }
}

// Interpolate component `c` of the nodes' light, (nodes, 4).
EVS_INLINE Float interpolate(const float* nodes, const CellLanes& cells, int c) {
  Float corner[4];
  for (int k = 0; k < 4; k++) corner[k] = gather(nodes + c, cells.node[k] * splat(4));
  Float low = corner[0] + (corner[1] - corner[0]) * cells.x;
  Float high = corner[2] + (corner[3] - corner[2]) * cells.x;
  return low + (high - low) * cells.y;
}

// Where the hits `lit` read the cache.
struct CacheCells {
  CellLanes first, second;
  Float share;   // of the second
  Mask blended;  // lanes that read both
};

// Read the irradiance over pi there; its colours only where COLOURS. In: the nodes' light.
template <bool COLOURS>
EVS_INLINE void read_cells(const float* nodes, const CacheCells& cells, Mask lit, Received& out) {
  constexpr int GREY = 3;
  bool blended = any(cells.blended);
  for (int c = COLOURS ? 0 : GREY; c <= GREY; c++) {
    Float light =
        select(lit, interpolate(nodes, cells.first, c) * (1.0f - cells.share), splat(0.0f));
    if (blended) {
      Float second = light + interpolate(nodes, cells.second, c) * cells.share;
      light = select(cells.blended, second, light);
    }
    (c == GREY ? out.luminance : out.colour[c]) = light;
  }
}

// Find the cells of the hits of `lit`. Nodes that are missing are requested, and the cells are then
// incomplete.
template <int CHANNELS>
void cells_of_hits(const Frame& f, const IrradianceView& cache, NodeRequests& requests,
                   const Rays& rays, const Hit& hit,
                   const SurfaceInteraction<CHANNELS>& interaction, Mask lit, Float path_length,
                   CacheCells& out) {
  // the level of each lane, and how much the next one counts
  Float width =
      f.orthographic ? splat(cache.spacing) : (path_length + hit.distance) * cache.spacing;
  width = min(max(width, splat(1e-12f)), splat(1e12f));
  Int bits = as_int(width), zero = splat(0);
  Int level = shift_right<23>(bits) - splat(127);
  Float mantissa = as_float((bits & splat(0x7fffff)) | splat(0x3f800000));
  out.share = max((mantissa - BLEND_FROM) * (1 / (2 - BLEND_FROM)), splat(0.0f));
  out.blended = lit & (out.share > 0.0f);
  out.first = out.second = {{zero, zero, zero, zero}, splat(0.0f), splat(0.0f)};
  for (unsigned lanes = to_bits(lit); lanes;) {
    int geom = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(geom)) & mask_from_bits(lanes);
    lanes &= ~to_bits(here);
    const Geom& g = f.geoms[geom];
    Vec p = to_local(g.rotation, interaction.point - splat(g.position));
    if (rays.common) p = splat(g.camera) + to_local(g.rotation, rays.direction) * hit.distance;
    Vec n = to_local(g.rotation, interaction.geometric_normal);
    for (unsigned left = to_bits(here); left;) {
      int index = lane(level, first_lane(left));
      Mask at_level = (level == splat(index)) & mask_from_bits(left);
      left &= ~to_bits(at_level);
      find_cells(cache, requests, g, geom, index, p, n, at_level, out.first);
      at_level = at_level & out.blended;
      if (any(at_level))
        find_cells(cache, requests, g, geom, index + 1, p, n, at_level, out.second);
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
