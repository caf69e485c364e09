// Surface interaction: position, normals and material at each lane's hit, evaluated geom by geom.
#pragma once

#include "render/geometry/intersect.inl"
#include "render/shading/checkerboard.inl"
#include "render/shading/footprint.inl"
#include "render/shading/texture.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int MAX_LAYERS = 8;  // surfaces behind seven transparent ones are not seen

template <int CHANNELS>
struct SurfaceInteraction {
  Vec point, normal;     // camera frame; the normal is the shading normal, unit, and faces the ray
  Vec geometric_normal;  // of the surface itself; faces the ray
  Vec spawn_point;       // origin of rays that leave the surface
  float step = 0;        // from point to spawn_point, at most
  Float albedo[CHANNELS];
  Float emitted[CHANNELS];  // emitted radiance
  Float
      specular_tint[CHANNELS];  // as in MuJoCo's viewer a texture colours the highlight too; else 1
  Float specular, exponent, reflectance, alpha;
  Vec unmapped_normal;  // where frame.normal_mapped: the shading normal before normal mapping
  // where frame.lobes:
  Float occlusion;            // ambient occlusion: share of the ambient light that arrives
  Mask physical;              // GGX lanes; the others are classic Blinn-Phong with metallic 0
  Float metallic, alpha_ggx;  // alpha_ggx: width of the GGX lobe, roughness squared
  Float f0[CHANNELS];         // specular reflectance at normal incidence
};

// Texture coordinates and filter widths at a sample, computed on first use.
struct TextureLookup {
  const Frame& f;
  const Geom& g;
  const Surface& s;
  Vec p;               // in the geom's frame
  Float footprint;     // width of the sample, m
  unsigned lanes;      // active
  bool has_texcoords;  // a mesh with texture coordinates
  Float u, v;          // its coordinates, and their density (image lengths per m)
  Float uv_density;
  // of camera rays; null: read an image once, as wide as `footprint`
  const Footprint* sample_footprint = nullptr;
  const Hit* hit = nullptr;
  const Rays* rays = nullptr;
  bool has_flat = false, has_cube = false;
  Float flat_u = {}, flat_v = {}, flat_width = {}, cube_u = {}, cube_v = {}, cube_width = {};
  Int face = {};
  Vec on_cube_at = {}, cube_x = {}, cube_y = {};  // on the cube: the point, and the sample's sides
  // the sample's sides on the 2D image and on the cube's face, image lengths
  Float flat_side[4] = {}, cube_side[4] = {};

  EVS_OUTLINE void find_flat() {
    has_flat = true;
    if (has_texcoords) {
      float ru = s.repeat[0] * (s.uniform && g.size[0] > 0 ? g.size[0] : 1.0f);
      float rv = s.repeat[1] * (s.uniform && g.size[1] > 0 ? g.size[1] : 1.0f);
      flat_u = u * ru;
      flat_v = v * rv;
      flat_width = footprint * uv_density * (ru > rv ? ru : rv);
      if (!sample_footprint) return;
      Slopes grow = slopes_on_mesh(f.meshes[g.mesh], *hit, lanes);
      find_sides({grow.u * splat(ru), grow.v * splat(rv)});
      return;
    }
    float per_meter;
    shape_coordinates(g, s, p, flat_u, flat_v, per_meter);
    flat_width = footprint * per_meter;
    if (sample_footprint) find_sides(slopes_on_shape(g, s, p));
  }

  void find_sides(const Slopes& grow) {
    flat_side[0] = dot(grow.u, sample_footprint->x);
    flat_side[1] = dot(grow.v, sample_footprint->x);
    flat_side[2] = dot(grow.u, sample_footprint->y);
    flat_side[3] = dot(grow.v, sample_footprint->y);
  }

  EVS_OUTLINE void find_cube() {
    has_cube = true;
    Vec q = unit_shape_point(g, p);
    float third = g.shape == CAPSULE || g.shape == CYLINDER ? g.size[1] : g.size[2];
    bool round = g.shape == SPHERE || g.shape == CAPSULE || g.shape == CYLINDER;
    float second = round ? g.size[0] : g.size[1];
    if (g.shape == SPHERE) third = g.size[0];
    float per_meter =
        g.shape == MESH || g.shape == HFIELD || g.shape == PLANE ? 1.0f : 1.0f / g.size[0];
    if (s.uniform) {
      q = {q.x * g.size[0], q.y * second, q.z * third};
      per_meter = 1.0f;
    }
    Float major;
    cube_coordinates(q, cube_u, cube_v, face, major);
    cube_width = footprint * (0.5f * per_meter) / major;
    if (!sample_footprint) return;
    Vec grow = unit_shape_slope(g, p);
    if (s.uniform) grow = {grow.x * g.size[0], grow.y * second, grow.z * third};
    on_cube_at = q;
    cube_x = {sample_footprint->x.x * grow.x, sample_footprint->x.y * grow.y,
              sample_footprint->x.z * grow.z};
    cube_y = {sample_footprint->y.x * grow.x, sample_footprint->y.y * grow.y,
              sample_footprint->y.z * grow.z};
    footprint_on_cube(cube_x, cube_u, cube_v, face, major, cube_side[0], cube_side[1]);
    footprint_on_cube(cube_y, cube_u, cube_v, face, major, cube_side[2], cube_side[3]);
  }

  template <int CHANNELS>
  [[gnu::noinline]] EVS_OUTLINE void read_tiles(const Texture& t, Float* out) {
    TileWeights weights = tile_weights(f, *rays, t, flat_u, flat_v, flat_side, *sample_footprint,
                                       hit->distance, lanes);
    for (int c = 0; c < CHANNELS; c++) {
      out[c] = c < t.channels ? weights.mean(t, c) : splat(t.mean);
    }
  }

  template <int CHANNELS>
  EVS_OUTLINE void read(const Texture& t, Float* out) {
    bool flat = t.faces == 1;
    if (flat && !has_flat) find_flat();
    if (!flat && !has_cube) find_cube();
    if (!sample_footprint) {
      if (flat)
        return sample_texture(t, CHANNELS, flat_u, flat_v, splat(0), flat_width, lanes, out);
      return sample_texture(t, CHANNELS, cube_u, cube_v, face, cube_width, lanes, out);
    }
    if (t.columns.count) return read_tiles<CHANNELS>(t, out);
    float w = static_cast<float>(t.level[0].width), h = static_cast<float>(t.level[0].height);
    const Float* side = flat ? flat_side : cube_side;
    Probes probes = probes_of(f, side[0] * w, side[1] * h, side[2] * w, side[3] * h, lanes);
    Float along_u = side[0] * probes.across_x + side[2] * probes.across_y;
    Float along_v = side[1] * probes.across_x + side[3] * probes.across_y;
    // probes may lie across the cube's edges
    Vec major_axis = cube_x * probes.across_x + cube_y * probes.across_y;
    int taps = f.taps > 1 ? f.taps : 1;
    for (int k = 0; k < taps; k++) {
      // the tap's offset from the pixel's centre, in sides of a tap
      float x = taps > 1 ? f.tap_x[k] / f.tap_width : 0.0f;
      float y = taps > 1 ? -f.tap_y[k] / f.tap_width : 0.0f;
      Float texel[CHANNELS], *to = k == 0 ? out : texel;
      if (flat) {
        Float from_u = flat_u + (side[0] * x + side[2] * y);
        Float from_v = flat_v + (side[1] * x + side[3] * y);
        read_probes<CHANNELS>(t, probes, lanes, to, [&](Float along, Float& u, Float& v, Int& on) {
          u = from_u + along_u * along;
          v = from_v + along_v * along;
          on = splat(0);
        });
      } else {
        Vec from = on_cube_at + (cube_x * splat(x) + cube_y * splat(y));
        read_probes<CHANNELS>(t, probes, lanes, to, [&](Float along, Float& u, Float& v, Int& on) {
          Float major;
          cube_coordinates(from + major_axis * along, u, v, on, major);
        });
      }
      if (k == 0) continue;
      for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + texel[c];
    }
    if (taps == 1) return;
    for (int c = 0; c < CHANNELS; c++) out[c] = out[c] * (1.0f / static_cast<float>(taps));
  }
};

// Interpolate a mesh's normal and texture coordinates, lane by lane.
inline void interpolate_corners(const Mesh& mesh, const Hit& hit, unsigned lanes, Vec& smooth,
                                Vec& geometric, Float& u, Float& v, Float& uv_density) {
  alignas(64) float out[9][LANES] = {};
  alignas(64) int triangle[LANES];
  alignas(64) float a[LANES], b[LANES];
  store(triangle, hit.triangle);
  store(a, hit.u);
  store(b, hit.v);
  for (; lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    const Corners& c = mesh.corners[triangle[i]];
    const Triangle& t = mesh.triangles[triangle[i]];
    float wu = a[i], wv = b[i], w = 1.0f - wu - wv;
    out[0][i] = w * c.normal[0].x + wu * c.normal[1].x + wv * c.normal[2].x;
    out[1][i] = w * c.normal[0].y + wu * c.normal[1].y + wv * c.normal[2].y;
    out[2][i] = w * c.normal[0].z + wu * c.normal[1].z + wv * c.normal[2].z;
    out[3][i] = t.normal.x;
    out[4][i] = t.normal.y;
    out[5][i] = t.normal.z;
    out[6][i] = w * c.uv[0][0] + wu * c.uv[1][0] + wv * c.uv[2][0];
    out[7][i] = w * c.uv[0][1] + wu * c.uv[1][1] + wv * c.uv[2][1];
    out[8][i] = c.uv_density;
  }
  smooth = {load(out[0]), load(out[1]), load(out[2])};
  geometric = {load(out[3]), load(out[4]), load(out[5])};
  u = load(out[6]);
  v = load(out[7]);
  uv_density = load(out[8]);
}

// A hit in its geom's own frame.
struct LocalHit {
  Vec p, d;                      // point, and direction of the ray
  Vec normal, geometric_normal;  // unit; the geometric one of a mesh is its triangle's
  Float u, v, uv_density;        // texture coordinates of a mesh
  bool is_mesh;
};

inline LocalHit local_hit(const Frame& f, const Geom& g, const Rays& rays, const Hit& hit,
                          unsigned lanes) {
  LocalHit s;
  s.d = to_local(g.rotation, rays.direction);
  s.p = local_origin(g, rays) + s.d * hit.distance;
  s.is_mesh = g.shape == MESH || g.shape == HFIELD;
  if (s.is_mesh) {
    interpolate_corners(f.meshes[g.mesh], hit, lanes, s.normal, s.geometric_normal, s.u, s.v,
                        s.uv_density);
    s.geometric_normal = normalize(s.geometric_normal);
  } else {
    s.normal = normal_of_shape(g, s.p);
  }
  if (g.shape != PLANE) s.normal = normalize(s.normal);
  return s;
}

// Mirror reflectance. As in MuJoCo's renderer, a plane mirrors on its front, and a box on its +Z
// face only. In the geom's frame: the geometric `normal`, and the ray's direction `d`.
EVS_INLINE Float mirror_reflectance(const Geom& g, const Surface& s, Vec normal, Vec d) {
  if (!(s.reflectance > 0) || (g.shape != PLANE && g.shape != BOX)) return splat(s.reflectance);
  return select((normal.z > 0.5f) & (d.z < 0.0f), splat(s.reflectance), splat(0.0f));
}

// Flip a normal towards the ray: interpolated normals may face away at a silhouette.
EVS_INLINE Vec face_forward(Vec normal, Vec direction) {
  return select(dot(normal, direction) > 0.0f, normal * splat(-1.0f), normal);
}

// Material parameters after the surface's texture maps.
template <int CHANNELS>
struct MaterialParameters {
  Float opacity, occlusion, metallic, alpha_ggx, specular, exponent;
  Float emitted[CHANNELS] = {};
};

template <int CHANNELS>
void apply_maps(const Frame& f, const Surface& s, TextureLookup& lookup,
                MaterialParameters<CHANNELS>& out) {
  Float value;
  auto scale = [&](int map, Float& number) {
    if (map < 0) return;
    lookup.read<1>(f.textures[map], &value);
    number = number * value;
  };
  scale(s.opacity_map, out.opacity);
  scale(s.occlusion_map, out.occlusion);
  scale(s.metallic_map, out.metallic);
  if (s.roughness_map >= 0) {
    Float rough = splat(s.roughness);
    scale(s.roughness_map, rough);
    rough = max(rough, splat(MIN_ROUGHNESS));
    out.alpha_ggx = rough * rough;
  }
  if (s.emissive_map >= 0) {
    lookup.template read<CHANNELS>(f.textures[s.emissive_map], out.emitted);
    for (int c = 0; c < CHANNELS; c++) out.emitted[c] = out.emitted[c] * s.emission;
  }
}

// Widen the specular lobe by the variance of the normals under it, so that distant bumps do not
// glint. Blinn-Phong keeps its peak when it widens, so it is also scaled down.
template <int CHANNELS>
void widen_lobe(Float variance, MaterialParameters<CHANNELS>& out) {
  out.alpha_ggx = min(sqrt(out.alpha_ggx * out.alpha_ggx + variance * 2.0f), splat(1.0f));
  Float exponent = out.exponent / (1.0f + out.exponent * variance);
  out.specular = out.specular * ((1.0f + exponent) / (1.0f + out.exponent));
  out.exponent = exponent;
}

// Tangents of a mesh: the image's right and top in the mesh's frame, from the triangle's corners.
inline void mesh_tangents(const Mesh& mesh, const Hit& hit, unsigned lanes, Vec& right, Vec& up) {
  alignas(64) float out[6][LANES] = {};
  alignas(64) int triangle[LANES];
  store(triangle, hit.triangle);
  for (; lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    const Corners& c = mesh.corners[triangle[i]];
    const Triangle& t = mesh.triangles[triangle[i]];
    V3 e1 = t.b - t.a, e2 = t.c - t.a;
    float u1 = c.uv[1][0] - c.uv[0][0], v1 = c.uv[1][1] - c.uv[0][1];
    float u2 = c.uv[2][0] - c.uv[0][0], v2 = c.uv[2][1] - c.uv[0][1];
    float side = u1 * v2 - u2 * v1 < 0 ? -1.0f : 1.0f;
    V3 along = scaled(scaled(e1, v2) - scaled(e2, v1), side);
    V3 above = scaled(scaled(e1, u2) - scaled(e2, u1), side);  // v grows downwards
    // normalise each, or those of a tiny triangle would underflow
    along = normalized(along);
    above = normalized(above);
    out[0][i] = along.x;
    out[1][i] = along.y;
    out[2][i] = along.z;
    out[3][i] = above.x;
    out[4][i] = above.y;
    out[5][i] = above.z;
  }
  right = {load(out[0]), load(out[1]), load(out[2])};
  up = {load(out[3]), load(out[4]), load(out[5])};
}

// Apply a normal map: red bends the normal to the image's right, green to its top. Cube maps, whose
// tangents change from face to face, are ignored. Out: the variance of the normals that a sample
// averages (Toksvig 2005).
inline Vec mapped_normal(const Frame& f, const Hit& hit, unsigned lanes, TextureLookup& lookup,
                         Vec n, Float& variance) {
  variance = splat(0.0f);
  const Texture& map = f.textures[lookup.s.normal_map];
  if (map.faces != 1) return n;
  Vec right, up;
  if (lookup.has_texcoords) {
    mesh_tangents(f.meshes[lookup.g.mesh], hit, lanes, right, up);
  } else {
    shape_tangents(lookup.g, lookup.p, n, right, up);
  }
  // make the tangents orthogonal to the normal
  right = normalize(right - n * dot(n, right));
  up = normalize(up - n * dot(n, up));
  // bend the normal
  Float c[3];
  lookup.read<3>(map, c);
  Float length = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
  // 1e-5: the rounding of unit normals
  variance = max((1.0f - length) / max(length, splat(0.05f)) - 1e-5f, splat(0.0f));
  return normalize(right * c[0] + up * c[1] + n * c[2]);
}

// Evaluate the hits of geom `index` in the lanes `here`, which are all active lanes if ALONE.
// `footprint_width`: width of a sample across its ray, m.
template <int CHANNELS, bool ALONE>
void interact_with_geom(const Frame& f, const Rays& rays, const Hit& hit, Float path_length,
                        Float footprint_width, int index, Mask here,
                        SurfaceInteraction<CHANNELS>& out) {
  auto assign = [here](auto& to, auto value) {
    if constexpr (ALONE) {
      to = value;
    } else {
      to = select(here, value, to);
    }
  };
  unsigned lanes = to_bits(here);
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  auto [p, d, n, flat, mesh_u, mesh_v, mesh_uv_density, is_mesh] =
      local_hit(f, g, rays, hit, lanes);
  bool textured = s.texture >= 0 || s.layered, filtered = textured && rays.primary && f.probes > 0;
  if (textured && !filtered) {
    // an oblique footprint is stretched: use the geometric mean of its two widths
    Float slant = max(abs(dot(n, d)), splat(0.02f));
    footprint_width = footprint_width / sqrt(slant);
  }
  bool has_texcoords = is_mesh && f.meshes[g.mesh].has_texcoords;
  TextureLookup lookup = {
      f, g, s, p, footprint_width, lanes, has_texcoords, mesh_u, mesh_v, mesh_uv_density};
  Footprint sample_footprint;
  if (filtered) {
    // round shapes have silhouettes, where the footprint would grow without bound
    bool even = is_mesh || g.shape == PLANE || g.shape == BOX;
    sample_footprint =
        footprint_of(f, g, rays, hit.distance, d, is_mesh ? flat : n, even ? 1e-3f : 0.1f);
    lookup.sample_footprint = &sample_footprint;
    lookup.hit = &hit;
    lookup.rays = &rays;
  }
  // albedo
  Float albedo[CHANNELS], tint[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) albedo[c] = splat(s.albedo[c]), tint[c] = splat(1.0f);
  if (s.texture >= 0) {
    lookup.template read<CHANNELS>(f.textures[s.texture], albedo);
    for (int c = 0; c < CHANNELS; c++) tint[c] = albedo[c];
  }
  // normals and mirror
  Vec outward = to_camera(g.rotation, n);
  Float mirror = mirror_reflectance(g, s, n, d);
  if (f.normal_mapped) assign(out.unmapped_normal, outward);
  assign(out.geometric_normal, is_mesh ? to_camera(g.rotation, flat) : outward);
  // material and its maps
  MaterialParameters<CHANNELS> material = {splat(s.alpha),    splat(1.0f),
                                           splat(s.metallic), splat(s.alpha_ggx),
                                           splat(s.specular), splat(s.exponent)};
  for (int c = 0; c < CHANNELS; c++) material.emitted[c] = albedo[c] * s.emission;
  if (s.layered) apply_maps<CHANNELS>(f, s, lookup, material);
  if (s.normal_map >= 0) {
    Float variance;
    n = mapped_normal(f, hit, lanes, lookup, n, variance);
    widen_lobe(variance, material);
    outward = to_camera(g.rotation, n);
  }
  assign(out.normal, outward);
  // origin of the rays that leave the surface
  Vec origin = out.point;
  if (is_mesh) {
    // step off the triangle, just far enough for the rounding of the hit point and the mesh
    Float step = (path_length + hit.distance) * 2e-5f + f.bounds.radius[index] * 1e-5f;
    origin = origin + to_camera(g.rotation, flat) * step;
    float longest = reduce_max(select(here, step, splat(0.0f)));
    out.step = longest > out.step ? longest : out.step;
  }
  // write the lanes of this geom
  assign(out.spawn_point, origin);
  for (int c = 0; c < CHANNELS; c++) {
    assign(out.albedo[c], albedo[c]);
    assign(out.specular_tint[c], tint[c]);
    assign(out.emitted[c], material.emitted[c]);
  }
  assign(out.specular, material.specular);
  assign(out.exponent, material.exponent);
  assign(out.reflectance, mirror);
  assign(out.alpha, material.opacity);
  if (!f.lobes) return;
  assign(out.occlusion, material.occlusion);
  assign(out.alpha_ggx, material.alpha_ggx);
  assign(out.metallic, s.physical ? material.metallic : splat(0.0f));
  assign(out.physical, s.physical ? here : mask_from_bits(0));
  for (int c = 0; c < CHANNELS; c++) {
    Float f0 = tint[c] * s.f0;
    if (s.physical) f0 = 0.04f + (albedo[c] - 0.04f) * material.metallic;
    assign(out.f0[c], f0);
  }
}

// Evaluate the interactions of the hits of `lanes`; other lanes are undefined. `path_length`:
// distance from the camera to the rays' origin.
template <int CHANNELS>
EVS_OUTLINE_IN_PATHS SurfaceInteraction<CHANNELS> surface_interaction(
    const Frame& f, const Rays& rays, const Hit& hit, unsigned lanes, Float path_length) {
  SurfaceInteraction<CHANNELS> out;
  out.point = rays.origin + rays.direction * hit.distance;
  Float footprint_width =
      f.orthographic ? splat(f.pixel_angle) : (path_length + hit.distance) * f.pixel_angle;
  // in most packets all lanes hit one geom; else go geom by geom
  int index = lanes ? lane(hit.geom, first_lane(lanes)) : -1;
  Mask here = (hit.geom == splat(index)) & mask_from_bits(lanes);
  if (lanes && to_bits(here) == lanes) {
    interact_with_geom<CHANNELS, true>(f, rays, hit, path_length, footprint_width, index, here,
                                       out);
  } else {
    Vec point = out.point;
    out = SurfaceInteraction<CHANNELS>{};
    out.point = point;
    while (lanes) {
      index = lane(hit.geom, first_lane(lanes));
      here = (hit.geom == splat(index)) & mask_from_bits(lanes);
      lanes &= ~to_bits(here);
      interact_with_geom<CHANNELS, false>(f, rays, hit, path_length, footprint_width, index, here,
                                          out);
    }
  }
  out.normal = face_forward(out.normal, rays.direction);
  if (f.normal_mapped) out.unmapped_normal = face_forward(out.unmapped_normal, rays.direction);
  return out;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
