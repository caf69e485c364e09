// The light of the irradiance cache's nodes: where they lie on meshes, and paths that start there.
#pragma once

#include "render/integrators/wavefront.inl"
#include "scene/irradiance.h"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Vec load_vector(float* const* from, int at) {
  return {load(from[0] + at), load(from[1] + at), load(from[2] + at)};
}
EVS_INLINE void store_lane(float* const* to, int at, const float (*from)[LANES], int i) {
  for (int a = 0; a < 3; a++) to[a][at] = from[a][i];
}

// Spread points over an emitter's surface.
inline void lamp_points(const Frame& f, const PathFrame& p, int emitter, const float* x,
                        const float* y, LampPoint* points) {
  const Emitter& e = p.emitters[emitter];
  const Geom& g = f.geoms[e.geom];
  Mask all = mask_from_bits(ALL_LANES);
  for (int at = 0; at < LAMP_POINTS; at += LANES) {
    alignas(64) float index[LANES], parts[11][LANES];
    for (int i = 0; i < LANES; i++) index[i] = static_cast<float>(at + i);
    Hit hit = {splat(1.0f), splat(e.geom), splat(0), splat(0.0f), splat(0.0f)};
    Vec q, normal;
    Float u_triangle = (load(index) + 0.5f) * (1.0f / LAMP_POINTS);
    sample_area(f, e, u_triangle, {load(x + at), load(y + at)}, all, q, normal, hit);
    Vec position = to_camera(g.rotation, q) + splat(g.position);
    Vec up = to_camera(g.rotation, normal);
    // look at the point from 1 m above it
    Rays rays = {position + up, up * splat(-1.0f), false};
    SurfaceInteraction<3> interaction =
        surface_interaction<3>(f, rays, hit, ALL_LANES, splat(0.0f));
    Float area = (e.end - e.begin) / (area_pdf(e, g, q) * static_cast<float>(LAMP_POINTS));
    if (e.axis < 0) {
      normal = up;
    } else {
      position = q;
    }
    const Float numbers[10] = {position.x,
                               position.y,
                               position.z,
                               normal.x,
                               normal.y,
                               normal.z,
                               area,
                               interaction.emitted[0],
                               interaction.emitted[1],
                               interaction.emitted[2]};
    for (int k = 0; k < 10; k++) store(parts[k], numbers[k]);
    for (int i = 0; i < LANES; i++) {
      points[at + i] = {{parts[0][i], parts[1][i], parts[2][i]},
                        {parts[3][i], parts[4][i], parts[5][i]},
                        parts[6][i],
                        {parts[7][i], parts[8][i], parts[9][i]}};
    }
  }
}

// Store where the nodes of `lanes` from place `at` on lie, on geom `index`. In: its own frame.
inline void store_placed(const Frame& f, const NodeArray& nodes, int at, int index, Vec point,
                         Vec normal, Vec flat, Mask lanes) {
  const Geom& g = f.geoms[index];
  // step off a triangle
  bool mesh = g.shape == MESH || g.shape == HFIELD;
  Float step = load(nodes.path_length + at) * 2e-5f + f.bounds.radius[index] * 1e-5f;
  if (!mesh) step = splat(0.0f);
  const Vec placed[4] = {to_camera(g.rotation, point) + splat(g.position),
                         to_camera(g.rotation, normal), to_camera(g.rotation, flat),
                         to_camera(g.rotation, point + flat * step) + splat(g.position)};
  float* const* to[4] = {nodes.point, nodes.normal, nodes.geometric_normal, nodes.spawn_point};
  for (int k = 0; k < 4; k++) {
    alignas(64) float parts[3][LANES];
    store(parts[0], placed[k].x);
    store(parts[1], placed[k].y);
    store(parts[2], placed[k].z);
    for (unsigned left = to_bits(lanes); left; left &= left - 1) {
      int i = first_lane(left);
      store_lane(to[k], at + i, parts, i);
    }
  }
}

// Place nodes begin ... end of one geom, a mesh, in the camera frame. The arrays are LANES longer
// than the nodes.
inline void place_mesh_nodes(const Frame& f, const NodeArray& nodes, int begin, int end) {
  int index = nodes.geom[begin];
  const Geom& g = f.geoms[index];
  const Mesh& mesh = f.meshes[g.mesh];
  for (int at = begin; at < end; at += LANES) {
    int count = end - at < LANES ? end - at : LANES;
    Mask active = mask_from_bits(first_lanes(count));
    // look down at the surface
    Vec origin = load_vector(nodes.origin, at), direction = load_vector(nodes.direction, at);
    Hit hit = {select(active, load(nodes.reach + at), splat(-1.0f)), splat(index), splat(0),
               splat(0.0f), splat(0.0f)};
    Mask found = intersect_mesh(mesh, mesh_rays(mesh, origin, direction), splat(0.0f), hit.distance,
                                hit.triangle, hit.u, hit.v) &
                 active;
    Vec smooth = splat(V3{0, 0, 1}), flat = smooth;
    Float u, v, uv_density;
    interpolate_corners(mesh, hit, to_bits(found), smooth, flat, u, v, uv_density);
    Vec other = load_vector(nodes.hit_point, at), normal = load_vector(nodes.hit_normal, at);
    Vec point = select(found, origin + direction * hit.distance, other);
    // the other one as it is: move_hidden_nodes takes the same
    smooth = select(found, normalize(smooth), normal);
    flat = select(found, normalize(flat), normal);
    // interpolated normals may face away from the surface
    smooth = select(dot(smooth, flat) > 0.0f, smooth, flat);
    store_placed(f, nodes, at, index, point, smooth, flat, active);
  }
}

// Move nodes that the hits that asked for them do not see to these hits: they would bring light, or
// darkness, from behind a wall.
inline void move_hidden_nodes(const Frame& f, const NodeArray& nodes) {
  constexpr float LIFT = 1e-3f / 40;  // of the path length: a thousandth of the lattice
  for (int at = 0; at < nodes.count; at += LANES) {
    unsigned left = first_lanes(nodes.count - at);
    alignas(64) int geoms[LANES] = {};
    for (int i = 0; i < LANES && at + i < nodes.count; i++) geoms[i] = nodes.geom[at + i];
    Int geom = load(geoms);
    while (left) {
      int index = geoms[first_lane(left)];
      Mask here = (geom == splat(index)) & mask_from_bits(left);
      left &= ~to_bits(here);
      const Geom& g = f.geoms[index];
      Vec point = load_vector(nodes.hit_point, at), normal = load_vector(nodes.hit_normal, at);
      Float lift = load(nodes.path_length + at) * LIFT;
      Vec from = to_camera(g.rotation, point + normal * lift) + splat(g.position);
      Vec to = load_vector(nodes.point, at) + load_vector(nodes.geometric_normal, at) * lift;
      Vec way = to - from;
      Float distance = sqrt(max(dot(way, way), splat(1e-30f)));
      way = way * (1.0f / distance);
      RayCone cone = ray_cone(from, way, here, T_INFINITY);
      Mask hidden = occluded(f, from, way, distance, geom, cone, here, 0);
      if (!any(hidden)) continue;
      store_placed(f, nodes, at, index, point, normal, normal, hidden);
    }
  }
}

// A density that is small beside every density of light sampling: a ray that finds an emitter that
// light sampling could find as well then counts for nothing.
constexpr float LAMPS_ELSEWHERE = 1e-20f;

// Start the paths of samples `first` ... of a packet of nodes. In: for each lane its node and its
// sample. Lamps and sampled emitters, which `hybrid` finds from each pixel, are left out.
inline void start_node_paths(const Frame& f, const PathFrame& p, Wavefront& front,
                             const NodeArray& nodes, const int* node, const int* sample,
                             Mask active) {
  PathBatch& b = front.batch;
  alignas(64) float parts[13][LANES];
  alignas(64) int geom[LANES], hash[LANES];
  for (int i = 0; i < LANES; i++) {
    int k = node[i];
    float* const* from[4] = {nodes.point, nodes.normal, nodes.geometric_normal, nodes.spawn_point};
    for (int j = 0; j < 12; j++) parts[j][i] = from[j / 3][j % 3][k];
    parts[12][i] = nodes.path_length[k];
    geom[i] = nodes.geom[k];
    hash[i] = nodes.hash[k];
  }
  Float zero = splat(0.0f), one = splat(1.0f);
  auto vector = [&](int j) { return Vec{load(parts[j]), load(parts[j + 1]), load(parts[j + 2])}; };
  // white paper at the node, seen from above
  ShadingPoint at = {};
  at.interaction.point = vector(0);
  at.interaction.normal = vector(3);
  at.interaction.geometric_normal = vector(6);
  at.interaction.spawn_point = vector(9);
  Bsdf& s = at.bsdf;
  s.normal = at.interaction.normal;
  axes_of(s.normal, p.world, s.x, s.y);
  s.cos_outgoing = s.alpha = one;
  s.mirror = s.mirror_probability = s.specular_probability = zero;
  s.physical = mask_from_bits(0);
  for (int c = 0; c < 3; c++) {
    s.specular[c] = at.received[c] = zero;
    s.diffuse[c] = one;
  }
  PathState path;
  path.sampler = {load(hash),     reverse_bits(load(sample)),
                  p.sample_set,   p.seed,
                  p.log2_samples, p.block,
                  p.log2_blocks,  p.quarters};
  path.rays = {at.interaction.point, s.normal * splat(-1.0f), false};
  path.hit = {zero, load(geom), splat(0), zero, zero};
  for (Float& share : path.throughput) share = one;
  path.path_length = load(parts[12]);
  path.pdf = zero;
  path.mirrored = one;
  path.specular_bounce = mask_from_bits(0);
  PathFrame without_emitters = p;
  without_emitters.emitter_count = 0;
  if (p.environment_probability > 0) without_emitters.environment_probability = 1;
  // the light of the sky, and the next rays
  Float out[3] = {zero, zero, zero}, sampled_light[3];
  Int from_geom;
  Mask continuing = scatter_paths(f, without_emitters, 0, path, active, nullptr, at, from_geom,
                                  sampled_light, out);
  Mask alive = mask_from_bits(0);
  if (any(continuing)) {
    RayCone cone = ray_cone(path.rays.origin, path.rays.direction, continuing, T_INFINITY);
    alive =
        intersect_paths(f, without_emitters, 1, path, cone, from_geom, continuing, nullptr, out);
  }
  for (int c = 0; c < 3; c++) store(b.light[c] + front.slots, out[c]);
  path.pdf = splat(LAMPS_ELSEWHERE);
  if (any(alive)) enqueue(front, front.paths, path, splat(front.slots) + load(LANE), alive);
  front.paths += __builtin_popcount(to_bits(alive));
  front.slots += LANES;
}

// Sum samples first ... first + count of the irradiance over pi of each node, but for lamps and
// sampled emitters. Out: (nodes.count, 3).
inline void light_nodes(const Frame& f, const PathFrame& p, PathBatch& batch,
                        const NodeArray& nodes, int first, int count, float* sums) {
  int room = PathBatch::ROOM / count;
  for (int begin = 0; begin < nodes.count; begin += room) {
    int end = begin + room < nodes.count ? begin + room : nodes.count;
    int paths = (end - begin) * count;
    Wavefront front = {batch, nullptr};
    for (int at = 0; at < paths; at += LANES) {
      alignas(64) int node[LANES], sample[LANES];
      for (int i = 0; i < LANES; i++) {
        int k = at + i < paths ? at + i : paths - 1;
        node[i] = begin + k / count;
        sample[i] = first + k % count;
      }
      start_node_paths(f, p, front, nodes, node, sample, mask_from_bits(first_lanes(paths - at)));
    }
    finish_paths(f, p, front);
    for (int k = begin; k < end; k++) {
      for (int c = 0; c < 3; c++) {
        float sum = 0;
        for (int s = 0; s < count; s++) sum += batch.light[c][(k - begin) * count + s];
        sums[3 * k + c] = sum;
      }
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
