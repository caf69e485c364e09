// Light that can be aimed at: points on glowing geoms and directions of the sky, drawn with a
// density that can also be asked for any hit, so that both ways to find a light can be weighed.
#pragma once

#include "path_scene.h"
#include "shading/bsdf.inl"
#include "shading/surface_interaction.inl"

namespace evs::EVS_SPACE {
namespace {

struct Aim {
  Vec towards;     // unit
  Float distance;  // FAR: the sky
  Float light[3];
  Float density;  // per sr; 0: nothing was drawn
};

// First index of a rising table whose value is over `x`; the table's last value counts as 1.
EVS_INLINE Int search(const float* table, Int begin, int count, Float x) {
  Int low = splat(0);
  int step = 1;
  while (2 * step < count) step *= 2;
  for (; step >= 1; step /= 2) {
    Int middle = low + splat(step);
    Mask inside = middle < splat(count);
    Float below = gather(table, begin + select(inside, middle - splat(1), splat(0)));
    low = select(inside & (below <= x), middle, low);
  }
  return low;
}

// The same from where a guide of as many entries says.
EVS_INLINE Int search_on(const float* table, Int begin, int count, const int32_t* guide, Float x) {
  Int part = truncate(min(x * static_cast<float>(count), splat(static_cast<float>(count - 1))));
  Int at = as_int(gather(reinterpret_cast<const float*>(guide), begin + part));
  for (;;) {
    Mask on = (gather(table, begin + at) <= x) & (at < splat(count - 1));
    if (!any(on)) return at;
    at = select(on, at + splat(1), at);
  }
}

// Where in its step x lies, 0 ... 1.
EVS_INLINE Float within(const float* table, Int begin, Int index, Float x) {
  Mask first = index == splat(0);
  Float low =
      select(first, splat(0.0f), gather(table, begin + select(first, splat(0), index - splat(1))));
  Float high = gather(table, begin + index);
  return max(min((x - low) / max(high - low, splat(1e-20f)), splat(0.99999994f)), splat(0.0f));
}

// A direction as a place on the sky's cube.
struct SkyPlace {
  Float u, v, major;  // major: the direction's largest component
  Int face;
};
EVS_INLINE SkyPlace on_sky(const Frame& f, Vec d) {
  SkyPlace at;
  Vec w = to_camera(f.sky_rotation, d);
  on_cube({w.x, w.z, -w.y}, at.u, at.v, at.face, at.major);
  return at;
}

// Radiance of the sky at a place, where a surface scatters with the density `lobe`, per sr, or
// where one drawn as wide sees it. `shown`: mirrors see it, which show no ambient light. A wide
// lobe sees the sky blurred by a sixteenth of its own width, and at most by a texel of 32 a face
// (after Krivanek & Colbert 2008): a small bright spot gives less noise, and what is read lies
// close together.
inline void sky_light(const Frame& f, const PathFrame& p, const SkyPlace& at, Float lobe,
                      Mask shown, unsigned lanes, Float* light) {
  for (int c = 0; c < 3; c++) light[c] = select(shown, splat(0.0f), splat(p.dome[c]));
  Float width = 0.0625f / sqrt(max(lobe, splat(1.0f)));
  if (!f.orthographic) width = max(width, splat(f.pixel_angle));
  Float footprint = min(width * 0.5f / at.major, splat(1.0f / 32));
  auto add = [&](int texture, const float* tint) {
    Float texel[3];
    sample(f.textures[texture], 3, at.u, at.v, at.face, footprint, lanes, texel);
    for (int c = 0; c < 3; c++) light[c] = light[c] + texel[c] * tint[c];
  };
  constexpr float WHITE[3] = {1, 1, 1};
  if (f.skybox >= 0) add(f.skybox, WHITE);
  for (int i = 0; i < f.light_count; i++) {
    if (f.lights[i].kind == IMAGE) add(f.lights[i].texture, f.lights[i].diffuse);
  }
}

// The density of aiming at the sky's cell, per sr at a place in it.
EVS_INLINE Float density_of_cell(const PathFrame& p, Int cell, Float major) {
  return gather(p.sky.density, cell) / (major * major * major) * p.sky_share;
}

// The density of aiming at a place.
inline Float sky_density(const PathFrame& p, const SkyPlace& at) {
  if (p.sky.side == 0) return splat(0.0f);
  float last = static_cast<float>(p.sky.side - 1), side = static_cast<float>(p.sky.side);
  Int x = truncate(max(min(at.u * side, splat(last)), splat(0.0f)));
  Int y = truncate(max(min(at.v * side, splat(last)), splat(0.0f)));
  return density_of_cell(p, (at.face * splat(p.sky.side) + y) * splat(p.sky.side) + x, at.major);
}

// A direction of the sky, and as a place; its light is not asked for yet.
inline Aim aim_at_sky(const Frame& f, const PathFrame& p, Pair place, SkyPlace& at) {
  Int zero = splat(0);
  Int row = search_on(p.sky.rows, zero, 6 * p.sky.side, p.sky.row_guide, place.y);
  Float v = within(p.sky.rows, zero, row, place.y);
  Int begin = row * splat(p.sky.side);
  Int cell = search_on(p.sky.cells, begin, p.sky.side, p.sky.cell_guide, place.x);
  Float u = within(p.sky.cells, begin, cell, place.x);
  // row = face * side + y; the quotient of whole numbers this small is exact after rounding down
  Float side = splat(static_cast<float>(p.sky.side));
  Int face = truncate((to_float(row) + 0.5f) / side);
  Float s = (to_float(cell) + u) / side * 2.0f - 1.0f;
  Float t = (to_float(row - face * splat(p.sky.side)) + v) / side * 2.0f - 1.0f;
  Float one = splat(1.0f);
  Mask is_x = face < splat(2), is_y = ~is_x & (face < splat(4));
  Mask negative = (face & splat(1)) == splat(1);
  Vec x = {select(negative, -one, one), -t, select(negative, s, -s)};
  Vec y = {s, select(negative, -one, one), select(negative, -t, t)};
  Vec z = {select(negative, -s, s), -t, select(negative, -one, one)};
  Vec d = select(is_x, x, select(is_y, y, z));
  Float inverse = 1.0f / sqrt(s * s + t * t + 1.0f);
  at = {(s + 1.0f) * 0.5f, (t + 1.0f) * 0.5f, inverse, face};
  Aim aim;
  aim.towards = to_local(f.sky_rotation, Vec{d.x, -d.z, d.y} * inverse);
  aim.distance = splat(FAR);
  aim.density = density_of_cell(p, begin + cell, inverse);
  for (int c = 0; c < 3; c++) aim.light[c] = splat(0.0f);
  return aim;
}

// The cone in which a ball of `radius` is seen from `square` (squared distance) away: 1 - cosine of
// its half angle. The ball's inside sees nothing.
EVS_INLINE Float opening(Float square, float radius) {
  Float sine = min(radius * radius / square, splat(1.0f));
  return sine / (sqrt(max(1.0f - sine, splat(0.0f))) + 1.0f);
}

// A direction in that cone around `axis`, and the distance to the ball along it.
EVS_INLINE Vec into_cone(Vec axis, Float distance, float radius, Pair place, Float& reach) {
  Float open = opening(distance * distance, radius) * place.x;
  Float sine = sqrt(max(open * (2.0f - open), splat(0.0f))), x, y;
  circle(place.y, x, y);
  Vec across, up;
  axes_of(axis, across, up);
  Float along = distance * (1.0f - open), off = distance * sine;
  reach = along - sqrt(max(radius * radius - off * off, splat(0.0f)));
  return normalize(across * (x * sine) + up * (y * sine) + axis * (1.0f - open));
}

// A point on an analytic shape, uniform over its area; of an ellipsoid over the sphere that it is
// stretched from. In the geom's frame.
inline void point_on(const Geom& g, Pair place, Vec& q, Vec& normal) {
  const float* s = g.size;
  Float zero = splat(0.0f), one = splat(1.0f), x, y;
  switch (g.shape) {
    case PLANE:
      q = {(place.x * 2.0f - 1.0f) * s[0], (place.y * 2.0f - 1.0f) * s[1], zero};
      normal = {zero, zero, one};
      return;
    case BOX: {
      // pairs of faces by area, then the side, then the place
      float yz = s[1] * s[2], zx = s[2] * s[0], xy = s[0] * s[1], all = yz + zx + xy;
      Float u = place.x * all;
      Mask on_x = u < yz, on_y = ~on_x & (u < yz + zx);
      Float share = select(on_x, u * (1.0f / max(splat(yz), splat(1e-30f))),
                           select(on_y, (u - yz) / max(splat(zx), splat(1e-30f)),
                                  (u - (yz + zx)) / max(splat(xy), splat(1e-30f))));
      Mask back = share < 0.5f;
      Float side = select(back, -one, one);
      Float a = max(min(select(back, share, share - 0.5f) * 4.0f - 1.0f, one), -one);
      Float b = place.y * 2.0f - 1.0f;
      q = select(
          on_x, Vec{side * s[0], a * s[1], b * s[2]},
          select(on_y, Vec{a * s[0], side * s[1], b * s[2]}, Vec{a * s[0], b * s[1], side * s[2]}));
      normal = {select(on_x, side, zero), select(on_y, side, zero),
                select(on_x | on_y, zero, side)};
      return;
    }
    case CYLINDER: {
      float barrel = 2 * s[1], lid = 0.5f * s[0], all = barrel + 2 * lid;
      circle(place.y, x, y);
      Float u = place.x * all;
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
      // a slice of the sphere has as much area as the barrel around it
      circle(place.y, x, y);
      Float height = (place.x * 2.0f - 1.0f) * (s[0] + s[1]);
      Float beyond = height - max(min(height, splat(s[1])), splat(-s[1]));
      Float z = beyond * (1.0f / s[0]);
      Float ring = sqrt(max(1.0f - z * z, zero));
      normal = {x * ring, y * ring, z};
      q = {normal.x * s[0], normal.y * s[0], height};
      return;
    }
    default: {  // sphere, ellipsoid
      circle(place.y, x, y);
      Float z = place.x * 2.0f - 1.0f, ring = sqrt(max(1.0f - z * z, zero));
      Vec unit = {x * ring, y * ring, z};
      bool round = g.shape == SPHERE;
      float b = round ? s[0] : s[1], c = round ? s[0] : s[2];
      q = {unit.x * s[0], unit.y * b, unit.z * c};
      normal = normalize({unit.x * (1.0f / s[0]), unit.y * (1.0f / b), unit.z * (1.0f / c)});
    }
  }
}

// Points per m^2 that `point_on` and the choice of a triangle give, at a point of the geom's frame.
EVS_INLINE Float points_per_area(const Emitter& e, const Geom& g, Vec q) {
  float share = (e.end - e.begin) / e.area;
  if (g.shape != ELLIPSOID) return splat(share);
  const float* s = g.size;
  Vec n = {q.x * (1.0f / (s[0] * s[0])), q.y * (1.0f / (s[1] * s[1])),
           q.z * (1.0f / (s[2] * s[2]))};
  return share / (sqrt(max(dot(n, n), splat(1e-30f))) * (s[0] * s[1] * s[2]));
}

// A point on the glowing geom that `choice` picks, seen from `from`. `travelled` as for patch_of.
inline Aim aim_at_emitter(const Frame& f, const PathFrame& p, Vec from, Float choice, Pair place,
                          Mask wanted, Float travelled) {
  Aim aim = {splat(V3{0, 0, 1}), splat(0.0f), {}, splat(0.0f)};
  Hit hit = {splat(0.0f), splat(-1), splat(0), splat(0.0f), splat(0.0f)};
  for (int e = 0; e < p.emitter_count; e++) {
    const Emitter& emitter = p.emitters[e];
    Mask here = wanted & (choice >= emitter.begin);
    if (e + 1 < p.emitter_count) here = here & (choice < emitter.end);
    if (!any(here)) continue;
    const Geom& g = f.geoms[emitter.geom];
    float share = emitter.end - emitter.begin;
    if (g.shape == SPHERE) {
      Vec apart = splat(g.position) - from;
      Float square = dot(apart, apart), distance = sqrt(square), reach;
      Mask outside = here & (distance > g.size[0]);
      Vec w = into_cone(normalize(apart), distance, g.size[0], place, reach);
      Float density = share / (opening(square, g.size[0]) * (2 * PI));
      aim.towards = select(here, w, aim.towards);
      aim.distance = select(here, max(reach, splat(0.0f)), aim.distance);
      aim.density = select(outside, density, select(here, splat(0.0f), aim.density));
      hit.geom = select(here, splat(emitter.geom), hit.geom);
      continue;
    }
    Vec q, normal;
    if (emitter.cumulative) {
      const Mesh& mesh = f.meshes[g.mesh];
      Float u = min(max((choice - emitter.begin) / splat(share), splat(0.0f)), splat(0.99999994f));
      Int index = search(emitter.cumulative, splat(0), emitter.triangles, u);
      // uniform on the triangle
      Float root = sqrt(place.x);
      Float wb = root * (1.0f - place.y), wc = root * place.y;
      alignas(64) float parts[6][LANES] = {};
      alignas(64) int triangle[LANES];
      alignas(64) float b[LANES], c[LANES];
      store(triangle, index);
      store(b, wb);
      store(c, wc);
      for (unsigned lanes = bits(here); lanes; lanes &= lanes - 1) {
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
    } else {
      point_on(g, place, q, normal);
    }
    Vec w = to_camera(g.rotation, q) + splat(g.position) - from;
    Float square = max(dot(w, w), splat(1e-20f)), distance = sqrt(square);
    Vec towards = w * (1.0f / distance);
    Float cosine = -dot(to_camera(g.rotation, normal), towards);
    // light leaves the front only
    Mask front = here & (cosine > 1e-6f);
    Float density = points_per_area(emitter, g, q) * square / max(cosine, splat(1e-6f));
    aim.towards = select(here, towards, aim.towards);
    aim.distance = select(here, distance, aim.distance);
    aim.density = select(front, density, select(here, splat(0.0f), aim.density));
    hit.geom = select(here, splat(emitter.geom), hit.geom);
  }
  hit.distance = aim.distance;
  Mask drawn = wanted & (aim.density > 0.0f);
  if (any(drawn)) {
    Patch<3> patch = patch_of<3>(f, {from, aim.towards, false}, hit, bits(drawn), travelled);
    for (int c = 0; c < 3; c++) aim.light[c] = select(drawn, patch.emitted[c], splat(0.0f));
  }
  aim.density = aim.density * (1.0f - p.sky_share);
  return aim;
}

// The density with which `aim_at_emitter` finds what the rays of `lanes` hit; 0: it never does.
inline Float density_of_hit(const Frame& f, const PathFrame& p, const Rays& rays, const Hit& hit,
                            const Patch<3>& patch, unsigned lanes) {
  Float density = splat(0.0f);
  while (lanes) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_of(lanes);
    lanes &= ~bits(here);
    if (p.emitter_of_geom[index] < 0) continue;
    const Emitter& e = p.emitters[p.emitter_of_geom[index]];
    const Geom& g = f.geoms[index];
    if (g.shape == SPHERE) {
      Vec apart = splat(g.position) - rays.origin;
      Float whole = opening(dot(apart, apart), g.size[0]) * (2 * PI);
      density = select(here, (e.end - e.begin) / whole, density);
      continue;
    }
    Vec q = local_origin(g, rays) + to_local(g.rotation, rays.direction) * hit.distance;
    Float cosine = max(abs(dot(patch.flat, rays.direction)), splat(1e-6f));
    Float square = hit.distance * hit.distance;
    density = select(here, points_per_area(e, g, q) * square / cosine, density);
  }
  return density * (1.0f - p.sky_share);
}

}  // namespace
}  // namespace evs::EVS_SPACE
