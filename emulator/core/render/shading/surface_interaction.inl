// The surface at each lane's hit: point, normals, albedo and gloss, gathered geom by geom.
#pragma once

#include "geometry/intersect.inl"
#include "scene.h"
#include "shading/footprint.inl"
#include "shading/texture.inl"

namespace evs::EVS_SPACE {
namespace {

constexpr int MAX_LAYERS = 8;  // what lies behind seven transparent surfaces is not seen

template <int CHANNELS>
struct Patch {
  Vec point, normal;  // camera frame; the normal is unit and faces the ray
  Vec flat;           // normal of the surface itself, not of its shading; faces the ray
  Vec origin;         // where rays that leave the surface start
  float step = 0;     // from point to origin, at most
  Float albedo[CHANNELS];
  Float emitted[CHANNELS];     // radiance of its own
  Float gloss_tint[CHANNELS];  // a texture colours the gloss too, as in MuJoCo's viewer; else 1
  Float specular, exponent, reflectance, alpha;
  Vec plain;  // where frame.bumpy: the normal before a normal map bent it
  // where frame.lobes:
  Float occlusion;            // share of the ambient light that arrives
  Mask physical;              // GGX lanes; the others are classic: metallic 0
  Float metallic, alpha_ggx;  // alpha_ggx: width of the GGX lobe, roughness squared
  Float f0[CHANNELS];         // specular reflectance at normal incidence
};

// Where one sample lies on images, and how wide it is there; found when first asked for.
struct Place {
  const Frame& f;
  const Geom& g;
  const Surface& s;
  Vec p;            // in the geom's frame
  Float footprint;  // m
  unsigned lanes;   // that are asked for
  bool own;         // a mesh with coordinates of its own
  Float u, v;       // those, and their density (image lengths per m)
  Float density;
  // of camera rays; null: an image is read once, as wide as the footprint
  const Footprint* covered = nullptr;
  const Hit* hit = nullptr;
  bool has_flat = false, has_cube = false;
  Float flat_u = {}, flat_v = {}, flat_width = {}, cube_u = {}, cube_v = {}, cube_width = {};
  Int face = {};
  Vec on_cube_at = {}, cube_x = {}, cube_y = {};  // on the cube: the point, and a sample's sides
  // sides of a sample on the flat image and on the cube's face, image lengths
  Float flat_side[4] = {}, cube_side[4] = {};

  void find_flat() {
    has_flat = true;
    if (own) {
      float ru = s.repeat[0] * (s.uniform && g.size[0] > 0 ? g.size[0] : 1.0f);
      float rv = s.repeat[1] * (s.uniform && g.size[1] > 0 ? g.size[1] : 1.0f);
      flat_u = u * ru;
      flat_v = v * rv;
      flat_width = footprint * density * (ru > rv ? ru : rv);
      if (!covered) return;
      Slopes grow = slopes_on_mesh(f.meshes[g.mesh], *hit, lanes);
      find_sides({grow.u * splat(ru), grow.v * splat(rv)});
      return;
    }
    float per_meter;
    on_shape(g, s, p, flat_u, flat_v, per_meter);
    flat_width = footprint * per_meter;
    if (covered) find_sides(slopes_on_shape(g, s, p));
  }

  void find_sides(const Slopes& grow) {
    flat_side[0] = dot(grow.u, covered->x);
    flat_side[1] = dot(grow.v, covered->x);
    flat_side[2] = dot(grow.u, covered->y);
    flat_side[3] = dot(grow.v, covered->y);
  }

  void find_cube() {
    has_cube = true;
    Vec q = unit_point(g, p);
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
    on_cube(q, cube_u, cube_v, face, major);
    cube_width = footprint * (0.5f * per_meter) / major;
    if (!covered) return;
    Vec grow = unit_slope(g, p);
    if (s.uniform) grow = {grow.x * g.size[0], grow.y * second, grow.z * third};
    on_cube_at = q;
    cube_x = {covered->x.x * grow.x, covered->x.y * grow.y, covered->x.z * grow.z};
    cube_y = {covered->y.x * grow.x, covered->y.y * grow.y, covered->y.z * grow.z};
    side_on_cube(cube_x, cube_u, cube_v, face, major, cube_side[0], cube_side[1]);
    side_on_cube(cube_y, cube_u, cube_v, face, major, cube_side[2], cube_side[3]);
  }

  template <int CHANNELS>
  void read(const Texture& t, Float* out) {
    bool flat = t.faces == 1;
    if (flat && !has_flat) find_flat();
    if (!flat && !has_cube) find_cube();
    if (!covered) {
      if (flat) return sample(t, CHANNELS, flat_u, flat_v, splat(0), flat_width, lanes, out);
      return sample(t, CHANNELS, cube_u, cube_v, face, cube_width, lanes, out);
    }
    float w = static_cast<float>(t.level[0].width), h = static_cast<float>(t.level[0].height);
    const Float* side = flat ? flat_side : cube_side;
    Probes probes = probes_of(f, side[0] * w, side[1] * h, side[2] * w, side[3] * h, lanes);
    Float along_u = side[0] * probes.across_x + side[2] * probes.across_y;
    Float along_v = side[1] * probes.across_x + side[3] * probes.across_y;
    // over the cube's edges
    Vec way = cube_x * probes.across_x + cube_y * probes.across_y;
    int taps = f.taps > 1 ? f.taps : 1;
    for (int k = 0; k < taps; k++) {
      // of the pixel's place, in sides of a tap
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
          on_cube(from + way * along, u, v, on, major);
        });
      }
      if (k == 0) continue;
      for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + texel[c];
    }
    if (taps == 1) return;
    for (int c = 0; c < CHANNELS; c++) out[c] = out[c] * (1.0f / static_cast<float>(taps));
  }
};

// A mesh's normal and texture coordinates, lane by lane.
inline void corners_of(const Mesh& mesh, const Hit& hit, unsigned lanes, Vec& smooth, Vec& flat,
                       Float& u, Float& v, Float& density) {
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
    out[8][i] = c.density;
  }
  smooth = {load(out[0]), load(out[1]), load(out[2])};
  flat = {load(out[3]), load(out[4]), load(out[5])};
  u = load(out[6]);
  v = load(out[7]);
  density = load(out[8]);
}

// A hit in its geom's own frame.
struct Site {
  Vec p, d;             // point, and direction of the ray
  Vec normal, flat;     // unit; flat: of a mesh's triangle itself
  Float u, v, density;  // texture coordinates of a mesh
  bool is_mesh;
};

inline Site site_of(const Frame& f, const Geom& g, const Rays& rays, const Hit& hit,
                    unsigned lanes) {
  Site s;
  s.d = to_local(g.rotation, rays.direction);
  s.p = local_origin(g, rays) + s.d * hit.distance;
  s.is_mesh = g.shape == MESH || g.shape == HFIELD;
  if (s.is_mesh) {
    corners_of(f.meshes[g.mesh], hit, lanes, s.normal, s.flat, s.u, s.v, s.density);
    s.flat = normalize(s.flat);
  } else {
    s.normal = normal_of_shape(g, s.p);
  }
  if (g.shape != PLANE) s.normal = normalize(s.normal);
  return s;
}

// Share of a perfect mirror. As in MuJoCo's pictures a plane mirrors on its front, and of a box the
// +Z face alone. In the geom's frame: `normal` of the shape itself, and the ray's direction `d`.
EVS_INLINE Float mirror_share(const Geom& g, const Surface& s, Vec normal, Vec d) {
  if (!(s.reflectance > 0) || (g.shape != PLANE && g.shape != BOX)) return splat(s.reflectance);
  return select((normal.z > 0.5f) & (d.z < 0.0f), splat(s.reflectance), splat(0.0f));
}

// Smooth normals may turn away from the ray at a silhouette.
EVS_INLINE Vec facing(Vec normal, Vec direction) {
  return select(dot(normal, direction) > 0.0f, normal * splat(-1.0f), normal);
}

// What a surface's maps make of its numbers.
template <int CHANNELS>
struct Layers {
  Float opacity, occlusion, metallic, alpha_ggx, specular, exponent;
  Float emitted[CHANNELS] = {};
};

template <int CHANNELS>
void read_layers(const Frame& f, const Surface& s, Place& place, Layers<CHANNELS>& out) {
  Float value;
  auto scale = [&](int map, Float& number) {
    if (map < 0) return;
    place.read<1>(f.textures[map], &value);
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
    place.template read<CHANNELS>(f.textures[s.emissive_map], out.emitted);
    for (int c = 0; c < CHANNELS; c++) out.emitted[c] = out.emitted[c] * s.emission;
  }
}

// Gloss over normals of this variance: a wider lobe, and of Blinn-Phong's, which keeps its peak
// when it widens, a lower one. So far bumps do not glint.
template <int CHANNELS>
void widen(Float apart, Layers<CHANNELS>& out) {
  out.alpha_ggx = min(sqrt(out.alpha_ggx * out.alpha_ggx + apart * 2.0f), splat(1.0f));
  Float exponent = out.exponent / (1.0f + out.exponent * apart);
  out.specular = out.specular * ((1.0f + exponent) / (1.0f + out.exponent));
  out.exponent = exponent;
}

// Where an image's right and its top point, in the mesh's frame: from the coordinates of the
// triangle's corners.
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
    // lengths of their own: a tiny triangle's would be lost
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

// The normal that a normal map gives: red bends it to the image's right, green to its top. On a
// cube map, where right and top turn from face to face, it stays as it is.
// Out: `apart`, the variance of the normals that a sample averages (Toksvig 2005).
inline Vec bent_normal(const Frame& f, const Hit& hit, unsigned lanes, Place& place, Vec n,
                       Float& apart) {
  apart = splat(0.0f);
  const Texture& map = f.textures[place.s.normal_map];
  if (map.faces != 1) return n;
  Vec right, up;
  if (place.own) {
    mesh_tangents(f.meshes[place.g.mesh], hit, lanes, right, up);
  } else {
    shape_tangents(place.g, place.p, n, right, up);
  }
  right = normalize(right - n * dot(n, right));
  up = normalize(up - n * dot(n, up));
  Float c[3];
  place.read<3>(map, c);
  Float length = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
  // 1e-5: the rounding of unit normals
  apart = max((1.0f - length) / max(length, splat(0.05f)) - 1e-5f, splat(0.0f));
  return normalize(right * c[0] + up * c[1] + n * c[2]);
}

// What is at the hits of geom `index` in the lanes `here`, which are all that are asked for if
// ALONE. `reach`: width of what a sample sees across its ray, m.
template <int CHANNELS, bool ALONE>
void add_geom(const Frame& f, const Rays& rays, const Hit& hit, Float travelled, Float reach,
              int index, Mask here, Patch<CHANNELS>& out) {
  auto put = [here](auto& to, auto value) {
    if constexpr (ALONE) {
      to = value;
    } else {
      to = select(here, value, to);
    }
  };
  unsigned lanes = bits(here);
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  auto [p, d, n, flat, mesh_u, mesh_v, mesh_density, is_mesh] = site_of(f, g, rays, hit, lanes);
  bool textured = s.texture >= 0 || s.layered, probed = textured && rays.primary && f.probes > 0;
  if (textured && !probed) {
    // seen at a slant the footprint stretches: take the mean of its two widths
    Float slant = max(abs(dot(n, d)), splat(0.02f));
    reach = reach / sqrt(slant);
  }
  bool own = is_mesh && f.meshes[g.mesh].has_texcoords;
  Place place = {f, g, s, p, reach, lanes, own, mesh_u, mesh_v, mesh_density};
  Footprint covered;
  if (probed) {
    // a round shape ends where it is seen at a slant
    bool even = is_mesh || g.shape == PLANE || g.shape == BOX;
    covered = footprint_of(f, g, rays, hit.distance, d, is_mesh ? flat : n, even ? 1e-3f : 0.1f);
    place.covered = &covered;
    place.hit = &hit;
  }
  Float albedo[CHANNELS], tint[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) albedo[c] = splat(s.albedo[c]), tint[c] = splat(1.0f);
  if (s.texture >= 0) {
    place.template read<CHANNELS>(f.textures[s.texture], albedo);
    for (int c = 0; c < CHANNELS; c++) tint[c] = albedo[c];
  }
  Vec facing_out = to_camera(g.rotation, n);
  Float mirror = mirror_share(g, s, n, d);
  if (f.bumpy) put(out.plain, facing_out);
  put(out.flat, is_mesh ? to_camera(g.rotation, flat) : facing_out);
  Layers<CHANNELS> layers = {splat(s.alpha),     splat(1.0f),       splat(s.metallic),
                             splat(s.alpha_ggx), splat(s.specular), splat(s.exponent)};
  for (int c = 0; c < CHANNELS; c++) layers.emitted[c] = albedo[c] * s.emission;
  if (s.layered) read_layers<CHANNELS>(f, s, place, layers);
  if (s.normal_map >= 0) {
    Float apart;
    n = bent_normal(f, hit, lanes, place, n, apart);
    widen(apart, layers);
    facing_out = to_camera(g.rotation, n);
  }
  put(out.normal, facing_out);
  Vec origin = out.point;
  if (is_mesh) {
    // step off the triangle: far enough for the rounding of hit point and mesh, no further
    Float step = (travelled + hit.distance) * 2e-5f + f.bounds.radius[index] * 1e-5f;
    origin = origin + to_camera(g.rotation, flat) * step;
    float longest = highest(select(here, step, splat(0.0f)));
    out.step = longest > out.step ? longest : out.step;
  }
  put(out.origin, origin);
  for (int c = 0; c < CHANNELS; c++) {
    put(out.albedo[c], albedo[c]);
    put(out.gloss_tint[c], tint[c]);
    put(out.emitted[c], layers.emitted[c]);
  }
  put(out.specular, layers.specular);
  put(out.exponent, layers.exponent);
  put(out.reflectance, mirror);
  put(out.alpha, layers.opacity);
  if (!f.lobes) return;
  put(out.occlusion, layers.occlusion);
  put(out.alpha_ggx, layers.alpha_ggx);
  put(out.metallic, s.physical ? layers.metallic : splat(0.0f));
  put(out.physical, s.physical ? here : mask_of(0));
  for (int c = 0; c < CHANNELS; c++) {
    Float f0 = splat(s.f0);
    if (s.physical) f0 = 0.04f + (albedo[c] - 0.04f) * layers.metallic;
    put(out.f0[c], f0);
  }
}

// In: the hits of `lanes`. Out: what is there, of no meaning on other lanes. `travelled`: distance
// from the camera to the rays' start.
template <int CHANNELS>
Patch<CHANNELS> patch_of(const Frame& f, const Rays& rays, const Hit& hit, unsigned lanes,
                         Float travelled) {
  Patch<CHANNELS> out;
  out.point = rays.origin + rays.direction * hit.distance;
  Float reach = f.orthographic ? splat(f.pixel_angle) : (travelled + hit.distance) * f.pixel_angle;
  int index = lanes ? lane(hit.geom, first_lane(lanes)) : -1;
  Mask here = (hit.geom == splat(index)) & mask_of(lanes);
  if (lanes && bits(here) == lanes) {
    add_geom<CHANNELS, true>(f, rays, hit, travelled, reach, index, here, out);
  } else {
    Vec point = out.point;
    out = Patch<CHANNELS>{};
    out.point = point;
    while (lanes) {
      index = lane(hit.geom, first_lane(lanes));
      here = (hit.geom == splat(index)) & mask_of(lanes);
      lanes &= ~bits(here);
      add_geom<CHANNELS, false>(f, rays, hit, travelled, reach, index, here, out);
    }
  }
  out.normal = facing(out.normal, rays.direction);
  if (f.bumpy) out.plain = facing(out.plain, rays.direction);
  return out;
}

}  // namespace
}  // namespace evs::EVS_SPACE
