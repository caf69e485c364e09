// Light sampling: points on emissive geoms and directions of the environment, with a pdf that can
// also be evaluated for any hit. The path integrator combines it with BSDF sampling by multiple
// importance sampling.
#pragma once

#include "render/shading/bsdf.inl"
#include "render/shading/surface_interaction.inl"
#include "scene/light.h"
#include "scene/path_scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct LightSample {
  Vec wi;          // unit
  Float distance;  // T_INFINITY: the environment
  Float light[3];
  Float pdf;  // per sr; 0: no sample
};

// Binary search: the first entry of a CDF above `x`. The last entry counts as 1.
EVS_INLINE Int search_cdf(const float* cdf, Int begin, int count, Float x) {
  Int low = splat(0);
  int step = 1;
  while (2 * step < count) step *= 2;
  for (; step >= 1; step /= 2) {
    Int middle = low + splat(step);
    Mask inside = middle < splat(count);
    Float below = gather(cdf, begin + select(inside, middle - splat(1), splat(0)));
    low = select(inside & (below <= x), middle, low);
  }
  return low;
}

// The same search, started at a guide table with as many entries.
EVS_INLINE Int search_cdf_guided(const float* cdf, Int begin, int count, const int32_t* guide,
                                 Float x) {
  Int part = truncate(min(x * static_cast<float>(count), splat(static_cast<float>(count - 1))));
  Int at = as_int(gather(reinterpret_cast<const float*>(guide), begin + part));
  for (;;) {
    Mask on = (gather(cdf, begin + at) <= x) & (at < splat(count - 1));
    if (!any(on)) return at;
    at = select(on, at + splat(1), at);
  }
}

// Return where x lies in its step of the CDF, 0 ... 1.
EVS_INLINE Float cdf_fraction(const float* cdf, Int begin, Int index, Float x) {
  Mask first = index == splat(0);
  Float low =
      select(first, splat(0.0f), gather(cdf, begin + select(first, splat(0), index - splat(1))));
  Float high = gather(cdf, begin + index);
  return max(min((x - low) / max(high - low, splat(1e-20f)), splat(0.99999994f)), splat(0.0f));
}

// A direction as a point of the environment's cube map.
struct EnvironmentPoint {
  Float u, v, major;  // the direction's largest component
  Int face;
};
EVS_INLINE EnvironmentPoint environment_point(const Frame& f, Vec d) {
  EnvironmentPoint at;
  Vec w = to_camera(f.camera_to_world, d);
  cube_coordinates({w.x, w.z, -w.y}, at.u, at.v, at.face, at.major);
  return at;
}

// Radiance of the environment at a point, for a BSDF lobe of pdf `bsdf_pdf` (per sr). Mirrors
// (`shown`) see no ambient light. A wide lobe sees the environment blurred by a sixteenth of its
// width, and by at most a texel of 32 a face (after Krivanek & Colbert 2008): small bright spots
// give less noise, and texture reads stay close together.
inline void environment_radiance(const Frame& f, const PathFrame& p, const EnvironmentPoint& at,
                                 Float bsdf_pdf, Mask shown, Float mirrored, unsigned lanes,
                                 Float* light) {
  // uniform environment
  for (int c = 0; c < 3; c++) light[c] = select(shown, splat(0.0f), splat(p.ambient_radiance[c]));
  // width of the lookup
  Float width = 0.0625f / sqrt(max(bsdf_pdf, splat(1.0f)));
  if (!f.orthographic) width = max(width, mirrored * f.pixel_angle);
  Float footprint = min(width * 0.5f / at.major, splat(1.0f / 32));
  auto add = [&](int texture, const float* tint) {
    Float texel[3];
    sample_texture(f.textures[texture], 3, at.u, at.v, at.face, footprint, lanes, texel);
    for (int c = 0; c < 3; c++) light[c] = light[c] + texel[c] * tint[c];
  };
  // add the skybox, if it shines, and the image lights
  constexpr float WHITE[3] = {1, 1, 1};
  if (f.sky_shines) add(f.skybox, WHITE);
  for (int i = 0; i < f.light_count; i++) {
    if (f.lights[i].is_image()) add(f.lights[i].texture, f.lights[i].diffuse);
  }
}

// pdf of sampling a cell of the environment, per sr, at a point in it.
EVS_INLINE Float cell_pdf(const PathFrame& p, Int cell, Float major) {
  return gather(p.environment.pdf, cell) / (major * major * major) * p.environment_probability;
}

// pdf of sampling a point of the environment.
inline Float environment_pdf(const PathFrame& p, const EnvironmentPoint& at) {
  if (p.environment.side == 0) return splat(0.0f);
  float last = static_cast<float>(p.environment.side - 1),
        side = static_cast<float>(p.environment.side);
  Int x = truncate(max(min(at.u * side, splat(last)), splat(0.0f)));
  Int y = truncate(max(min(at.v * side, splat(last)), splat(0.0f)));
  return cell_pdf(p, (at.face * splat(p.environment.side) + y) * splat(p.environment.side) + x,
                  at.major);
}

// Sample a direction of the environment by its luminance. The radiance is not read yet.
inline LightSample sample_environment(const Frame& f, const PathFrame& p, Point2 u_point,
                                      EnvironmentPoint& at) {
  // sample a row, then a cell in it, then a point in the cell
  Int zero = splat(0);
  Int row = search_cdf_guided(p.environment.rows, zero, 6 * p.environment.side,
                              p.environment.row_guide, u_point.y);
  Float v = cdf_fraction(p.environment.rows, zero, row, u_point.y);
  Int begin = row * splat(p.environment.side);
  Int cell = search_cdf_guided(p.environment.cells, begin, p.environment.side,
                               p.environment.cell_guide, u_point.x);
  Float u = cdf_fraction(p.environment.cells, begin, cell, u_point.x);
  // row = face * side + y; the quotient of integers this small is exact after truncation
  Float side = splat(static_cast<float>(p.environment.side));
  Int face = truncate((to_float(row) + 0.5f) / side);
  Float s = (to_float(cell) + u) / side * 2.0f - 1.0f;
  Float t = (to_float(row - face * splat(p.environment.side)) + v) / side * 2.0f - 1.0f;
  // turn the point of the cube into a direction
  Float one = splat(1.0f);
  Mask is_x = face < splat(2), is_y = ~is_x & (face < splat(4));
  Mask negative = (face & splat(1)) == splat(1);
  Vec x = {select(negative, -one, one), -t, select(negative, s, -s)};
  Vec y = {s, select(negative, -one, one), select(negative, -t, t)};
  Vec z = {select(negative, -s, s), -t, select(negative, -one, one)};
  Vec d = select(is_x, x, select(is_y, y, z));
  Float inverse = 1.0f / sqrt(s * s + t * t + 1.0f);
  at = {(s + 1.0f) * 0.5f, (t + 1.0f) * 0.5f, inverse, face};
  LightSample out;
  out.wi = to_local(f.camera_to_world, Vec{d.x, -d.z, d.y} * inverse);
  out.distance = splat(T_INFINITY);
  out.pdf = cell_pdf(p, begin + cell, inverse);
  for (int c = 0; c < 3; c++) out.light[c] = splat(0.0f);
  return out;
}

// 1 - cos of the half angle of the cone in which a sphere of `radius` is seen from the squared
// distance `square`. A point inside the sphere sees nothing.
EVS_INLINE Float one_minus_cos_cone(Float square, float radius) {
  Float sine = min(radius * radius / square, splat(1.0f));
  return sine / (sqrt(max(1.0f - sine, splat(0.0f))) + 1.0f);
}

// Sample a direction in that cone, uniformly over its solid angle. In: `world` of axes_of. Out: the
// distance to the sphere.
EVS_INLINE Vec sample_cone(Vec axis, Float distance, float radius, Point2 u_point,
                           const float* world, Float& distance_to_sphere) {
  Float one_minus_cos = one_minus_cos_cone(distance * distance, radius) * u_point.x;
  Float sine = sqrt(max(one_minus_cos * (2.0f - one_minus_cos), splat(0.0f))), x, y;
  cos_sin_turns(u_point.y, x, y);
  Vec across, up;
  axes_of(axis, world, across, up);
  Float along = distance * (1.0f - one_minus_cos), off = distance * sine;
  distance_to_sphere = along - sqrt(max(radius * radius - off * off, splat(0.0f)));
  return normalize(across * (x * sine) + up * (y * sine) + axis * (1.0f - one_minus_cos));
}

// The probability of the specular lobe, instead of the bulb's cone, in `sample_bulb`: 0 where the
// lobe's density is nowhere in the cone above the cone's own. In: the cone of `sample_cone`.
inline Float bulb_lobe_probability(const Bsdf& s, Vec d, Vec axis, Float one_minus_cos,
                                   Mask active) {
  // most lobes are too wide wherever they point
  Float zero = splat(0.0f), solid_angle = one_minus_cos * (2 * PI);
  Float densest = smith_g1(s.cos_outgoing, s.alpha) /
                  (s.cos_outgoing * s.alpha * s.alpha * (4 * PI)) * solid_angle;
  Mask narrow = active & (s.specular_probability > 0.0f) & (densest > 1.0f);
  if (!any(narrow)) return zero;
  // the direction of the cone nearest to the mirror image, where the lobe is about at its densest
  Float cos_cone = 1.0f - one_minus_cos;
  Float sin_cone = sqrt(max(one_minus_cos * (2.0f - one_minus_cos), zero));
  Vec image = d - s.normal * (dot(d, s.normal) * 2.0f);
  Float cos_image = dot(image, axis);
  Vec edge = axis * cos_cone + normalize(image - axis * cos_image) * sin_cone;
  Float peak = visible_normal_pdf(s, d, select(cos_image > cos_cone, image, edge)) * solid_angle;
  // light that the lobes reflect, if all of the specular lobe lies in the cone
  Float specular = s.specular[0] + s.specular[1] + s.specular[2];
  Float diffuse = (s.diffuse[0] + s.diffuse[1] + s.diffuse[2]) * (1.0f / PI) * solid_angle *
                  max(dot(axis, s.normal), zero);
  // a sample then weighs at most about as much as what both lobes together reflect
  Float share = specular / max(specular + diffuse, splat(1e-20f));
  return select(narrow & (peak > 1.0f), (1.0f - 1.0f / max(peak, splat(1.0f))) * share, zero);
}

struct BulbSample {
  Vec wi;          // unit
  Float distance;  // to the bulb's surface
  Float share;     // of the strength that the lamp would have as a point; 0: no sample
};

// Sample a direction to a spherical bulb, seen from outside: in its cone, or from a specular lobe
// that is narrower than the cone, weighted by the density of both together. In: direction and
// distance to the bulb's centre.
inline BulbSample sample_bulb(const Bsdf& s, Vec d, Vec axis, Float distance, float radius,
                              Point2 u_point, const float* world, Mask active) {
  BulbSample out;
  Float zero = splat(0.0f), one = splat(1.0f);
  Float square = distance * distance, one_minus_cos = one_minus_cos_cone(square, radius);
  Float to_lobe = bulb_lobe_probability(s, d, axis, one_minus_cos, active);
  Mask narrow = to_lobe > 0.0f, from_lobe = narrow & (u_point.x < to_lobe);
  // use what is left of the number that chose
  if (any(narrow)) {
    Float rest = select(from_lobe, u_point.x / max(to_lobe, splat(1e-20f)),
                        (u_point.x - to_lobe) / max(1.0f - to_lobe, splat(1e-20f)));
    u_point.x = select(narrow, max(min(rest, splat(0.99999994f)), zero), u_point.x);
  }
  out.wi = sample_cone(axis, distance, radius, u_point, world, out.distance);
  out.share = 2.0f * one_minus_cos * square * (1.0f / (radius * radius));
  if (!any(narrow)) return out;
  if (any(from_lobe)) {
    Float cosine, sine;
    cos_sin_turns(u_point.y, cosine, sine);
    Vec local = sample_visible_normal(s, d, u_point.x, cosine, sine);
    Vec w = normalize(s.x * local.x + s.y * local.y + s.normal * local.z);
    // intersect the bulb
    Vec off = cross(axis, w) * distance;
    Float past = dot(off, off), along = dot(axis, w) * distance;
    Mask met = (past < radius * radius) & (along > 0.0f);
    Float to_surface = along - sqrt(max(radius * radius - past, zero));
    out.wi = select(from_lobe, w, out.wi);
    out.distance = select(from_lobe, to_surface, out.distance);
    out.share = select(from_lobe & ~met, zero, out.share);
  }
  // the density of both together, relative to the cone's
  Float lobe = visible_normal_pdf(s, d, out.wi) * one_minus_cos * (2 * PI);
  out.share = select(narrow, out.share / (one - to_lobe + to_lobe * lobe), out.share);
  return out;
}

// Sample a point of an analytic shape uniformly by area; of an ellipsoid, uniformly on the sphere
// that it is stretched from. In the geom's frame.
inline void sample_shape(const Geom& g, Point2 u_point, Vec& q, Vec& normal) {
  const float* s = g.size;
  Float zero = splat(0.0f), one = splat(1.0f), x, y;
  switch (g.shape) {
    case PLANE:
      q = {(u_point.x * 2.0f - 1.0f) * s[0], (u_point.y * 2.0f - 1.0f) * s[1], zero};
      normal = {zero, zero, one};
      return;
    case BOX: {
      // choose a pair of faces by area, then the side, then the point
      float yz = s[1] * s[2], zx = s[2] * s[0], xy = s[0] * s[1], all = yz + zx + xy;
      Float u = u_point.x * all;
      Mask on_x = u < yz, on_y = ~on_x & (u < yz + zx);
      Float share = select(on_x, u * (1.0f / max(splat(yz), splat(1e-30f))),
                           select(on_y, (u - yz) / max(splat(zx), splat(1e-30f)),
                                  (u - (yz + zx)) / max(splat(xy), splat(1e-30f))));
      Mask back = share < 0.5f;
      Float side = select(back, -one, one);
      Float a = max(min(select(back, share, share - 0.5f) * 4.0f - 1.0f, one), -one);
      Float b = u_point.y * 2.0f - 1.0f;
      q = select(
          on_x, Vec{side * s[0], a * s[1], b * s[2]},
          select(on_y, Vec{a * s[0], side * s[1], b * s[2]}, Vec{a * s[0], b * s[1], side * s[2]}));
      normal = {select(on_x, side, zero), select(on_y, side, zero),
                select(on_x | on_y, zero, side)};
      return;
    }
    case CYLINDER: {
      float barrel = 2 * s[1], lid = 0.5f * s[0], all = barrel + 2 * lid;
      cos_sin_turns(u_point.y, x, y);
      Float u = u_point.x * all;
      Mask on_lid = u >= barrel;
      Float share = min((u - barrel) * (1.0f / lid), splat(1.999999f));
      Mask top = share >= 1.0f;
      Float radius = sqrt(max(select(top, share - 1.0f, share), zero)) * s[0];
      Float end = select(top, one, -one);
      q = select(on_lid, Vec{x * radius, y * radius, end * s[1]},
                 Vec{x * s[0], y * s[0], u - s[1]});
      normal = select(on_lid, Vec{zero, zero, end}, Vec{x, y, zero});
      return;
    }
    case CAPSULE: {
      // a slice of the sphere has the same area as the barrel around it
      cos_sin_turns(u_point.y, x, y);
      Float height = (u_point.x * 2.0f - 1.0f) * (s[0] + s[1]);
      Float beyond = height - max(min(height, splat(s[1])), splat(-s[1]));
      Float z = beyond * (1.0f / s[0]);
      Float ring = sqrt(max(1.0f - z * z, zero));
      normal = {x * ring, y * ring, z};
      q = {normal.x * s[0], normal.y * s[0], height};
      return;
    }
    default: {  // sphere, ellipsoid
      cos_sin_turns(u_point.y, x, y);
      Float z = u_point.x * 2.0f - 1.0f, ring = sqrt(max(1.0f - z * z, zero));
      Vec unit = {x * ring, y * ring, z};
      bool round = g.shape == SPHERE;
      float b = round ? s[0] : s[1], c = round ? s[0] : s[2];
      q = {unit.x * s[0], unit.y * b, unit.z * c};
      normal = normalize({unit.x * (1.0f / s[0]), unit.y * (1.0f / b), unit.z * (1.0f / c)});
    }
  }
}

// Area density (1 / m^2) of `sample_shape`, times the geom's probability, at a local point.
EVS_INLINE Float area_pdf(const Emitter& e, const Geom& g, Vec q) {
  float share = (e.end - e.begin) / e.area;
  if (g.shape != ELLIPSOID) return splat(share);
  const float* s = g.size;
  Vec n = {q.x * (1.0f / (s[0] * s[0])), q.y * (1.0f / (s[1] * s[1])),
           q.z * (1.0f / (s[2] * s[2]))};
  return share / (sqrt(max(dot(n, n), splat(1e-30f))) * (s[0] * s[1] * s[2]));
}

// Sample a point of an emitter by area, in the geom's frame. In: a number that selects a mesh's
// triangle, and two for the point. Out: point, normal, and of a mesh where the hit lies, in the
// lanes `here`.
inline void sample_area(const Frame& f, const Emitter& emitter, Float u_triangle, Point2 u_point,
                        Mask here, Vec& q, Vec& normal, Hit& hit) {
  const Geom& g = f.geoms[emitter.geom];
  if (!emitter.cumulative) return sample_shape(g, u_point, q, normal);
  const Mesh& mesh = f.meshes[g.mesh];
  Int index = search_cdf(emitter.cumulative, splat(0), emitter.triangles, u_triangle);
  // uniform on the triangle
  Float root = sqrt(u_point.x);
  Float wb = root * (1.0f - u_point.y), wc = root * u_point.y;
  alignas(64) float parts[6][LANES] = {};
  alignas(64) int triangle[LANES];
  alignas(64) float b[LANES], c[LANES];
  store(triangle, index);
  store(b, wb);
  store(c, wc);
  for (unsigned lanes = to_bits(here); lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    const Triangle& t = mesh.triangles[triangle[i]];
    float a = 1.0f - b[i] - c[i];
    parts[0][i] = a * t.a.x + b[i] * t.b.x + c[i] * t.c.x;
    parts[1][i] = a * t.a.y + b[i] * t.b.y + c[i] * t.c.y;
    parts[2][i] = a * t.a.z + b[i] * t.b.z + c[i] * t.c.z;
    parts[3][i] = t.normal.x;
    parts[4][i] = t.normal.y;
    parts[5][i] = t.normal.z;
  }
  q = {load(parts[0]), load(parts[1]), load(parts[2])};
  normal = normalize({load(parts[3]), load(parts[4]), load(parts[5])});
  hit.triangle = select(here, index, hit.triangle);
  hit.u = select(here, wb, hit.u);
  hit.v = select(here, wc, hit.v);
}

// Axes of a geom that is the same however it turns about `axis`, with the next one towards a point:
// what is fixed to them stays where it is as the geom spins. In: from the point to the geom's
// centre.
struct TurnedAxes {
  Vec axes[3];

  EVS_INLINE Vec to_camera(Vec v) const { return axes[0] * v.x + axes[1] * v.y + axes[2] * v.z; }
};
EVS_INLINE TurnedAxes turned_axes(const Geom& g, int axis, Vec apart) {
  const float* r = g.rotation;
  const int next = (axis + 1) % 3, last = (axis + 2) % 3;
  Vec along = splat(V3{r[axis], r[3 + axis], r[6 + axis]});
  Vec across = along * dot(apart, along) - apart;
  // a point on the axis has no side
  Mask off = dot(across, across) > dot(apart, apart) * 1e-10f;
  across = select(off, across, splat(V3{r[next], r[3 + next], r[6 + next]}));
  TurnedAxes turned;
  turned.axes[axis] = along;
  turned.axes[next] = normalize(across);
  turned.axes[last] = cross(along, turned.axes[next]);
  return turned;
}

// Sample a point on the emissive geom that `u_choice` selects, seen from `from`. `path_length` as
// in surface_interaction.
inline LightSample sample_emitter(const Frame& f, const PathFrame& p, Vec from, Float u_choice,
                                  Point2 u_point, Mask active, Float path_length) {
  LightSample out = {splat(V3{0, 0, 1}), splat(0.0f), {}, splat(0.0f)};
  Hit hit = {splat(0.0f), splat(-1), splat(0), splat(0.0f), splat(0.0f)};
  for (int e = 0; e < p.emitter_count; e++) {
    const Emitter& emitter = p.emitters[e];
    Mask here = active & (u_choice >= emitter.begin);
    if (e + 1 < p.emitter_count) here = here & (u_choice < emitter.end);
    if (!any(here)) continue;
    const Geom& g = f.geoms[emitter.geom];
    float share = emitter.end - emitter.begin;
    // sample the cone in which a sphere is seen
    if (g.shape == SPHERE) {
      Vec apart = splat(g.position) - from;
      Float square = dot(apart, apart), distance = sqrt(square), distance_to_sphere;
      Mask outside = here & (distance > g.size[0]);
      Vec w =
          sample_cone(normalize(apart), distance, g.size[0], u_point, p.world, distance_to_sphere);
      Float pdf = share / (one_minus_cos_cone(square, g.size[0]) * (2 * PI));
      out.wi = select(here, w, out.wi);
      out.distance = select(here, max(distance_to_sphere, splat(0.0f)), out.distance);
      out.pdf = select(outside, pdf, select(here, splat(0.0f), out.pdf));
      hit.geom = select(here, splat(emitter.geom), hit.geom);
      continue;
    }
    // sample a point of any other geom by area
    Vec q, normal;
    Float u = min(max((u_choice - emitter.begin) / splat(share), splat(0.0f)), splat(0.99999994f));
    sample_area(f, emitter, u, u_point, here, q, normal, hit);
    Vec w;
    if (emitter.axis < 0) {
      w = to_camera(g.rotation, q) + splat(g.position) - from;
      normal = to_camera(g.rotation, normal);
    } else {
      w = splat(g.position) - from;
      TurnedAxes turned = turned_axes(g, emitter.axis, w);
      w = turned.to_camera(q) + w;
      normal = turned.to_camera(normal);
    }
    // convert the area density to a solid angle
    Float square = max(dot(w, w), splat(1e-20f)), distance = sqrt(square);
    Vec wi = w * (1.0f / distance);
    Float cosine = -dot(normal, wi);
    // only the front emits
    Mask front = here & (cosine > 1e-6f);
    Float pdf = area_pdf(emitter, g, q) * square / max(cosine, splat(1e-6f));
    out.wi = select(here, wi, out.wi);
    out.distance = select(here, distance, out.distance);
    out.pdf = select(front, pdf, select(here, splat(0.0f), out.pdf));
    hit.geom = select(here, splat(emitter.geom), hit.geom);
  }
  // evaluate the radiance that is emitted there
  hit.distance = out.distance;
  Mask drawn = active & (out.pdf > 0.0f);
  if (any(drawn)) {
    SurfaceInteraction<3> interaction =
        surface_interaction<3>(f, {from, out.wi, false}, hit, to_bits(drawn), path_length);
    for (int c = 0; c < 3; c++) out.light[c] = select(drawn, interaction.emitted[c], splat(0.0f));
  }
  out.pdf = out.pdf * (1.0f - p.environment_probability);
  return out;
}

// pdf (per sr) with which `sample_emitter` samples the hits of `lanes`; 0 for hits that it never
// samples.
inline Float emitter_pdf(const Frame& f, const PathFrame& p, const Rays& rays, const Hit& hit,
                         const SurfaceInteraction<3>& interaction, unsigned lanes) {
  Float pdf = splat(0.0f);
  while (lanes) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_from_bits(lanes);
    lanes &= ~to_bits(here);
    if (p.emitter_of_geom[index] < 0) continue;
    const Emitter& e = p.emitters[p.emitter_of_geom[index]];
    const Geom& g = f.geoms[index];
    if (g.shape == SPHERE) {
      Vec apart = splat(g.position) - rays.origin;
      Float solid_angle = one_minus_cos_cone(dot(apart, apart), g.size[0]) * (2 * PI);
      pdf = select(here, (e.end - e.begin) / solid_angle, pdf);
      continue;
    }
    Vec q = local_origin(g, rays) + to_local(g.rotation, rays.direction) * hit.distance;
    Float cosine = max(abs(dot(interaction.geometric_normal, rays.direction)), splat(1e-6f));
    Float square = hit.distance * hit.distance;
    pdf = select(here, area_pdf(e, g, q) * square / cosine, pdf);
  }
  return pdf * (1.0f - p.environment_probability);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
