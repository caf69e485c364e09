// Anisotropic texture filtering along camera rays. The footprint of a sample is an ellipse on the
// image; it is read at several probes along its major axis, each as wide as the minor axis (after
// Feline, McCormack et al. 1999). The probes of a lane depend on its ray only.
#pragma once

#include "render/geometry/rays.inl"
#include "render/shading/texture.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Distance between neighbouring samples on the surface, along the image's rows and columns: geom's
// frame, m.
struct Footprint {
  Vec x, y;
  Float nearer_x, nearer_y;  // by how much the surface comes nearer along the ray, m
};

// In: point p, unit direction d and unit normal n in the geom's frame; `least` bounds the cosine
// between d and n from below, so that every footprint is finite.
EVS_INLINE Footprint footprint_of(const Frame& f, const Geom& g, const Rays& rays, Float distance,
                                  Vec d, Vec n, float least) {
  const float* r = g.rotation;
  Vec x = splat(V3{r[0], r[1], r[2]}), y = splat(V3{r[3], r[4], r[5]});
  Float width = splat(f.pixel_x), height = splat(f.pixel_y);
  if (f.lens) {
    // about equally wide everywhere, across the ray
    Vec aside = select(abs(d.y) < 0.9f, {splat(0.0f), splat(1.0f), splat(0.0f)},
                       {splat(1.0f), splat(0.0f), splat(0.0f)});
    x = normalize(cross(d, aside));
    y = cross(d, x);
    width = height = distance * f.pixel_angle;
  } else if (!f.orthographic) {
    Float depth = distance * -rays.direction.z;
    width = width * depth;
    height = height * depth;
  }
  // project along the ray onto the surface
  Float cosine = dot(d, n);
  cosine = select(cosine < 0.0f, min(cosine, splat(-least)), max(cosine, splat(least)));
  Float slope = 1.0f / cosine;
  Float fall_x = dot(x, n) * slope, fall_y = dot(y, n) * slope;
  return {(x - d * fall_x) * width, (y - d * fall_y) * height, fall_x * width, fall_y * height};
}

// Derivatives of `shape_coordinates` at a point: image lengths per m, geom's frame.
struct Slopes {
  Vec u, v;
};

inline Slopes slopes_on_shape(const Geom& g, const Surface& s, Vec p) {
  Float zero = splat(0.0f);
  float sx = g.size[0], sy = g.size[1];
  if (g.shape == PLANE && (sx <= 0 || sy <= 0)) {
    return {{splat(s.repeat[0] * (sx > 0 ? 0.5f / sx : 0.5f)), zero, zero},
            {zero, splat(s.repeat[1] * (sy > 0 ? -0.5f / sy : -0.5f)), zero}};
  }
  if (g.shape == MESH || g.shape == HFIELD) {
    float kx = s.uniform ? 1.0f : (sx > 0 ? 1.0f / sx : 1.0f);
    float ky = s.uniform ? 1.0f : (sy > 0 ? 1.0f / sy : 1.0f);
    return {{splat(0.5f * s.repeat[0] * kx), zero, zero},
            {zero, splat(-0.5f * s.repeat[1] * ky), zero}};
  }
  if (g.shape == CAPSULE || g.shape == CYLINDER || g.shape == SPHERE) sy = sx;
  float ru = s.repeat[0] * (s.uniform ? sx : 1.0f), rv = s.repeat[1] * (s.uniform ? sy : 1.0f);
  constexpr float TURN = 0.159154943f;  // 1 / (2 pi)
  Vec u = {splat(0.5f / sx), zero, zero}, v = {zero, splat(-0.5f / sy), zero};
  // derivative around the axis; 1e-6: at a pole every direction is around it
  float around_y = g.shape == ELLIPSOID ? g.size[1] : sx;
  Float qx = p.x * (1.0f / sx), qy = p.y * (1.0f / around_y);
  Float off = max(qx * qx + qy * qy, splat(1e-6f));
  Vec around = {-qy * (TURN / sx) / off, qx * (TURN / around_y) / off, zero};
  switch (g.shape) {
    case SPHERE:
    case ELLIPSOID: {
      float sz = g.shape == ELLIPSOID ? g.size[2] : sx;
      Float away = sqrt(off), fall = p.z * (2.0f * TURN / sz) / away;
      u = around;
      v = {fall * qx * (1.0f / sx), fall * qy * (1.0f / around_y), away * (-2.0f * TURN / sz)};
      break;
    }
    case CAPSULE: {
      Float beyond = abs(p.z) - g.size[1], away = sqrt(off);
      float cap = 4.0f * TURN / sx;
      Float fall = select(p.z < 0.0f, -beyond, beyond) * (cap / sx) / away;
      Mask on_cap = beyond > 0.0f;
      u = around;
      v = select(on_cap, {fall * qx, fall * qy, away * -cap},
                 {zero, zero, splat(-0.5f / (g.size[1] > 0 ? g.size[1] : sx))});
      break;
    }
    case CYLINDER: {
      Mask lid = g.size[1] - abs(p.z) < g.size[0] - sqrt(p.x * p.x + p.y * p.y);
      u = select(lid, u, around);
      v = select(lid, v, {zero, zero, splat(-0.5f / (g.size[1] > 0 ? g.size[1] : sx))});
      break;
    }
    case BOX: {
      Float x = abs(p.x) - g.size[0], y = abs(p.y) - g.size[1], z = abs(p.z) - g.size[2];
      Mask face_x = (x >= y) & (x >= z), face_z = (z > x) & (z > y);
      u = select(face_x, {zero, splat(0.5f / sy), zero}, u);
      v = select(face_z, v, {zero, zero, splat(-0.5f / g.size[2])});
      break;
    }
    default:  // a finite plane
      break;
  }
  return {u * splat(ru), v * splat(rv)};
}

// The same for a mesh with texture coordinates, lane by lane.
inline Slopes slopes_on_mesh(const Mesh& mesh, const Hit& hit, unsigned lanes) {
  alignas(64) float out[6][LANES] = {};
  alignas(64) int triangle[LANES];
  store(triangle, hit.triangle);
  for (; lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    const Corners& c = mesh.corners[triangle[i]];
    const Triangle& t = mesh.triangles[triangle[i]];
    V3 e1 = t.b - t.a, e2 = t.c - t.a, n = t.normal;
    float square = dot(n, n);
    if (!(square > 0)) continue;
    // each gradient is 1 along its edge and 0 along the other
    V3 first = {e2.y * n.z - e2.z * n.y, e2.z * n.x - e2.x * n.z, e2.x * n.y - e2.y * n.x};
    V3 second = {n.y * e1.z - n.z * e1.y, n.z * e1.x - n.x * e1.z, n.x * e1.y - n.y * e1.x};
    for (int k = 0; k < 2; k++) {
      float a = (c.uv[1][k] - c.uv[0][k]) / square, b = (c.uv[2][k] - c.uv[0][k]) / square;
      out[3 * k][i] = first.x * a + second.x * b;
      out[3 * k + 1][i] = first.y * a + second.y * b;
      out[3 * k + 2][i] = first.z * a + second.z * b;
    }
  }
  return {{load(out[0]), load(out[1]), load(out[2])}, {load(out[3]), load(out[4]), load(out[5])}};
}

// Derivative of `unit_shape_point` by axis, 1 / m.
EVS_INLINE Vec unit_shape_slope(const Geom& g, Vec p) {
  const float* s = g.size;
  Float x = splat(1.0f), y = x, z = x;
  if (g.shape == BOX || g.shape == ELLIPSOID) {
    return {splat(1.0f / s[0]), splat(1.0f / s[1]), splat(1.0f / s[2])};
  }
  if (g.shape == SPHERE || g.shape == CAPSULE || g.shape == CYLINDER) {
    x = y = z = splat(1.0f / s[0]);
    if (g.shape == CYLINDER) z = splat(1.0f / s[1]);
    if (g.shape == CAPSULE) z = select(abs(p.z) > splat(s[1]), z, splat(1.0f / s[1]));
  }
  return {x, y, z};
}

// Project a footprint's axis `side` onto the cube's face, at the point u, v.
EVS_INLINE void footprint_on_cube(Vec side, Float u, Float v, Int face, Float major, Float& along_u,
                                  Float& along_v) {
  Mask is_x = face < splat(2), is_y = ~is_x & (face < splat(4));
  Mask negative = (face & splat(1)) == splat(1);
  // as in cube_coordinates
  Float m = select(is_x, side.x, select(is_y, side.y, side.z));
  m = select(negative, -m, m);
  Float s = select(is_x, select(negative, side.z, -side.z),
                   select(is_y, side.x, select(negative, -side.x, side.x)));
  Float t = select(is_y, select(negative, -side.z, side.z), -side.y);
  Float half = 0.5f / major;
  along_u = (s - (u * 2.0f - 1.0f) * m) * half;
  along_v = (t - (v * 2.0f - 1.0f) * m) * half;
}

constexpr float PROBE_TEXELS = 1.4f;  // denser probes resolve nothing more
constexpr float PROBE_SLACK = 0.75f;  // of a probe's width: one probe stands for up to 1.25

// The probes of an ellipse on an image.
struct Probes {
  Float across_x, across_y;  // the major axis, in samples along each side
  Float count, share;        // probes of each lane, and the weight of one
  Float width;               // of a probe, texels
  int most;                  // most probes of any lane
};

// In: a sample's sides on the image, in texels: (xu, xv) and (yu, yv).
EVS_INLINE Probes probes_of(const Frame& f, Float xu, Float xv, Float yu, Float yv,
                            unsigned lanes) {
  // the singular values of the matrix of both sides, and the direction of the larger one
  Float x = xu * xu + xv * xv, y = yu * yu + yv * yv, both = xu * yu + xv * yv;
  Float half = (x - y) * 0.5f;
  Float square = max((x + y) * 0.5f + sqrt(half * half + both * both), splat(1e-12f));
  Float major = sqrt(square), minor = abs(xu * yv - xv * yu) / major;
  Mask wider = x >= y;
  Float a = select(wider, square - y, both), b = select(wider, both, square - x);
  Float scale = 1.0f / sqrt(max(a * a + b * b, splat(1e-24f)));
  Float wanted = major / max(minor, splat(PROBE_TEXELS)) + PROBE_SLACK;
  wanted = min(max(wanted, splat(1.0f)), splat(static_cast<float>(f.probes)));
  Probes out;
  out.count = to_float(truncate(select(mask_from_bits(lanes), wanted, splat(1.0f))));
  out.share = 1.0f / out.count;
  Float apart = max(minor, major * out.share);
  // interpolation between texels is as wide as a box of sqrt(3) texels; never read a smaller level
  // where the image is magnified
  out.width = sqrt(max(apart * apart, splat(1.0f)) * (1.0f / 3) + (2.0f / 3));
  out.across_x = a * scale;
  out.across_y = b * scale;
  out.most = static_cast<int>(reduce_max(out.count));
  return out;
}

// Average an image over the probes of each lane. `at(along, u, v, face)` places a probe on the
// major axis, along = -0.5 ... 0.5.
template <int CHANNELS, class At>
EVS_INLINE void read_probes(const Texture& t, const Probes& probes, unsigned lanes, Float* out,
                            const At& at) {
  Lod lod = lod_of_width(t, probes.width, lanes);
  Float u, v;
  Int face;
  for (int i = 0; i < probes.most; i++) {
    Float index = splat(static_cast<float>(i)), texel[CHANNELS];
    at((index + 0.5f) * probes.share - 0.5f, u, v, face);
    read_lod(t, CHANNELS, lod, u, v, face, i == 0 ? out : texel);
    if (i == 0) continue;
    Mask there = index < probes.count;
    for (int c = 0; c < CHANNELS; c++) out[c] = select(there, out[c] + texel[c], out[c]);
  }
  if (probes.most == 1) return;
  for (int c = 0; c < CHANNELS; c++) out[c] = out[c] * probes.share;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
