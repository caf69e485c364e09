// The `path` integrator: at each point of a path every light is asked at first and one of them
// later, glowing geoms and the sky are aimed at and also found by chance (multiple importance
// sampling, balance heuristic), and the path goes on in one direction that the surface draws.
#pragma once

#include "geometry/culling.inl"
#include "incremental/clearance.inl"
#include "integrators/sampler.inl"
#include "shading/environment.inl"
#include "shading/fog.inl"
#include "shading/light_sampling.inl"
#include "shading/lights.inl"

namespace evs::EVS_SPACE {
namespace {

// Which numbers a point of a path draws. Each light of the first point has its own after the last.
enum Draw {
  DRAW_PIXEL = 0,
  DRAW_PASS,
  DRAW_LOBE,
  DRAW_DIRECTION,
  DRAW_AIM,
  DRAW_PLACE,
  DRAW_LIGHT
};
constexpr int DRAWS = 1 << 20;  // of one point; the last are those of transparent layers

constexpr int SURE_BOUNCES = 2;  // after these a path ends by chance

// What share of the light arrives from `towards` of what is less than `limit` away. `idle`: as for
// `occluded`.
inline Float visibility(const Frame& f, const PathFrame& p, Vec origin, Vec towards, Float limit,
                        Int self, Mask wanted, unsigned idle, Clearance* clearance) {
  if (clearance && p.transparent) note(*clearance, origin, towards, limit, wanted);
  if (clearance && !p.transparent) note_shadow(*clearance, origin, towards, limit, wanted);
  Float zero = splat(0.0f), one = splat(1.0f);
  if (!barred_by_planes(f, idle) && !any_towards(f.around, origin, towards, wanted)) {
    return select(wanted, one, zero);
  }
  Hull hull = hull_of(origin, towards, wanted, FAR);
  if (!p.transparent) {
    Mask dark = occluded(f, origin, towards, limit, self, hull, wanted, idle);
    return select(dark | ~wanted, zero, one);
  }
  Float passing = select(wanted, one, zero), beyond = zero;
  Rays rays = {origin, towards, false};
  for (int layer = 0; layer < MAX_LAYERS && any(wanted); layer++) {
    Hit hit = closest(f, rays, hull, wanted, beyond);
    wanted = wanted & (hit.distance < limit) & ~(hit.geom < splat(0));
    if (!any(wanted)) return passing;
    Patch<3> patch = patch_of<3>(f, rays, hit, bits(wanted), zero);
    passing = select(wanted, passing * max(1.0f - patch.alpha, zero), passing);
    wanted = wanted & (passing > 0.0f);
    beyond = hit.distance;
  }
  return select(wanted, zero, passing);  // more layers than are followed: dark
}

EVS_INLINE bool is_bulb(const Light& light) {
  return light.radius > 0 && light.kind != DIRECTIONAL;
}

// The light of MuJoCo's lights that leaves the surface along -d, each weighed by `weight`.
inline void add_light(const Frame& f, const PathFrame& p, const Scattering& s, Vec d,
                      const Patch<3>& patch, Int self, Mask lit, const Light& light, Pair place,
                      Float weight, Clearance* clearance, Float* out) {
  Incidence in = incidence(light, patch.point);
  if (light.kind != DIRECTIONAL && light.ambient[0] + light.ambient[1] + light.ambient[2] > 0) {
    // fades as its light does, and has no shadow; that of the other lights is the sky's
    Float share = select(lit, in.strength * weight, splat(0.0f));
    for (int c = 0; c < 3; c++) {
      out[c] = out[c] + (s.diffuse[c] + s.gloss[c]) * share * light.ambient[c];
    }
  }
  if (is_bulb(light)) {
    // a bulb: as much light as a glowing ball gives, from somewhere on it
    Float square = in.distance * in.distance, reach;
    Mask outside = in.distance > light.radius;
    Vec towards = into_cone(in.towards, in.distance, light.radius, place, reach);
    Float share =
        2.0f * opening(square, light.radius) * square * (1.0f / (light.radius * light.radius));
    in.towards = select(outside, towards, in.towards);
    in.distance = select(outside, max(reach, splat(0.0f)), in.distance);
    in.strength = select(outside, in.strength * share, in.strength);
  }
  Mask facing = lit & (dot(in.towards, s.normal) > 0.0f) & (dot(in.towards, patch.flat) > 0.0f) &
                (in.strength > 0.0f) & (weight > 0.0f);
  if (!any(facing)) return;
  Float arrives = select(facing, splat(1.0f), splat(0.0f));
  if (light.castshadow && f.shadows) {
    arrives = visibility(f, p, patch.origin, in.towards, in.distance, self, facing, light.idle,
                         clearance);
    facing = facing & (arrives > 0.0f);
    if (!any(facing)) return;
  }
  Value v = evaluate(s, d, in.towards);
  // a light of diffuse E gives Lambert's surface the radiance albedo E: its irradiance is pi E
  Float scale = arrives * weight * in.strength * PI;
  for (int c = 0; c < 3; c++) {
    out[c] = out[c] + select(facing, v.light[c] * scale * light.diffuse[c], splat(0.0f));
  }
}

// Light of `lanes` that was met with `carried` left of it: times `weight`.
EVS_INLINE void add_seen(const Float* carried, const Float* light, Float weight, Mask lanes,
                         Float* out) {
  for (int c = 0; c < 3; c++) {
    out[c] = select(lanes, out[c] + carried[c] * light[c] * weight, out[c]);
  }
}

// The sky's light of rays that a surface scattered with `density`, weighed against aiming at it.
// `arrives`: what share gets through.
inline void add_sky(const Frame& f, const PathFrame& p, Vec d, Mask sure, Float density,
                    const Float* carried, Float arrives, Mask lanes, Float* out) {
  SkyPlace at = on_sky(f, d);
  Float light[3], aimed = sky_density(p, at);
  sky_light(f, p, at, select(sure, splat(FAR), density), sure, bits(lanes), light);
  Float weight = select(sure, splat(1.0f), density / max(density + aimed, splat(1e-30f)));
  add_seen(carried, light, weight * arrives, lanes, out);
}

// A packet of paths, each at a point of its own or on its way to the next. `bounce` is the same of
// all: how many points they have left behind.
struct Walk {
  Rays rays;
  Hit hit;  // of the rays
  Float carried[3];
  Float travelled;  // up to the rays' start
  Float density;    // with which the rays were drawn
  Mask sure;        // found in no other way: camera and mirror rays
  Sampler sampler;
};

// What the rays of `active` hit, and the light of those that hit nothing. `hull`: theirs; `left`:
// the geom that they come from; `clearance`: which learns of every ray, or null. Out: lanes that
// are to be shaded.
inline Mask cast(const Frame& f, const PathFrame& p, int bounce, Walk& w, const Hull& hull,
                 Int left, Mask active, Clearance* clearance, Float* out) {
  const Rays& rays = w.rays;
  Float zero = splat(0.0f), one = splat(1.0f);
  if (bounce > p.bounces && !p.glowing) {
    // the last rays can meet the sky or nothing
    if (!p.open) return mask_of(0);
    Float arrives =
        visibility(f, p, rays.origin, rays.direction, splat(FAR), left, active, 0, clearance);
    active = active & (arrives > 0.0f);
    if (any(active)) {
      add_sky(f, p, rays.direction, w.sure, w.density, w.carried, arrives, active, out);
    }
    return mask_of(0);
  }
  Hit hit = closest(f, rays, hull, active, zero);
  Mask lit = active & ~(hit.geom < splat(0));
  if (p.transparent) {
    // what a transparent surface lets pass goes on to the next one
    Mask passing = lit;
    for (int layer = 0; layer < MAX_LAYERS && any(passing); layer++) {
      Patch<3> patch = patch_of<3>(f, rays, hit, bits(lit), w.travelled);
      Float chance = pair_of(w.sampler, bounce * DRAWS + DRAWS - 1 - layer).x;
      passing = passing & lit & ~(chance < patch.alpha);
      if (!any(passing)) break;
      Hit next = closest(f, rays, hull, passing, hit.distance);
      Mask found = passing & ~(next.geom < splat(0));
      lit = (lit & ~passing) | found;
      hit = {select(passing, next.distance, hit.distance), select(passing, next.geom, hit.geom),
             select(passing, next.triangle, hit.triangle), select(passing, next.u, hit.u),
             select(passing, next.v, hit.v)};
    }
  }
  w.hit = hit;
  if (clearance) {
    Float end = select(lit, hit.distance, splat(FAR));
    meet(*clearance, hit.geom, lit);
    note(*clearance, rays.origin, rays.direction, end, active);
  }
  if (bounce == 0 && f.air.haze) lit = lit & ~beyond_haze(f, rays.direction, hit);
  Mask missed = active & ~lit;
  if (any(missed) && p.open) {
    if (bounce == 0) {
      Float light[3] = {zero, zero, zero};
      if (f.skybox >= 0) sky<3>(f, rays.direction, bits(missed), light);
      add_seen(w.carried, light, one, missed, out);
    } else {
      add_sky(f, p, rays.direction, w.sure, w.density, w.carried, one, missed, out);
    }
  }
  return lit;
}

// A point of a packet of paths: what is there, and the light that MuJoCo's lights give it.
struct Point {
  Patch<3> patch;
  Scattering scattering;
  Float received[3];
};

// In: the patch of the point that the paths of `lit` have reached. Out: the rest of it; its own
// light to `out`. False: the paths end there. `lamps`: learns of the rays to the first point's
// lights.
inline bool light_point(const Frame& f, const PathFrame& p, int bounce, const Walk& w, Mask lit,
                        Clearance* clearance, Clearance* lamps, Point& at, Float* out) {
  const Rays& rays = w.rays;
  const Hit& hit = w.hit;
  const Sampler& sampler = w.sampler;
  Float zero = splat(0.0f), one = splat(1.0f);
  int draws = bounce * DRAWS;
  const Patch<3>& patch = at.patch;
  Mask glowing = lit & (patch.emitted[0] + patch.emitted[1] + patch.emitted[2] > 0.0f);
  if (any(glowing)) {
    Float weight = one;
    if (any(glowing & ~w.sure)) {
      Float aimed = density_of_hit(f, p, rays, hit, patch, bits(glowing & ~w.sure));
      weight = select(w.sure, one, w.density / max(w.density + aimed, splat(1e-30f)));
    }
    add_seen(w.carried, patch.emitted, weight, glowing, out);
  }
  if (bounce > p.bounces) return false;

  const Scattering& s = at.scattering = scattering_of(patch, rays.direction);
  Float* received = at.received;
  for (int c = 0; c < 3; c++) received[c] = zero;
  // MuJoCo's lights: all of them at first, then one
  int count = p.lamp_count;
  if (bounce == 0) {
    for (int i = 0; i < f.light_count; i++) {
      if (f.lights[i].kind == IMAGE) continue;
      Pair place = {zero, zero};
      if (is_bulb(f.lights[i])) place = pair_of(sampler, draws + DRAW_LIGHT + 1 + i);
      add_light(f, p, s, rays.direction, patch, hit.geom, lit, f.lights[i], place, one, lamps,
                received);
    }
  } else if (count > 0) {
    Float chance = pair_of(sampler, draws + DRAW_LIGHT).x * static_cast<float>(count);
    Pair place = pair_of(sampler, draws + DRAW_LIGHT + 1);
    Int chosen = truncate(chance);
    for (int i = 0, lamp = 0; i < f.light_count; i++) {
      if (f.lights[i].kind == IMAGE) continue;
      Mask here = lit & (chosen == splat(lamp++));
      if (!any(here)) continue;
      add_light(f, p, s, rays.direction, patch, hit.geom, here, f.lights[i], place,
                splat(static_cast<float>(count)), clearance, received);
    }
  }
  return true;
}

// The same where the patch is not known yet.
inline bool arrive(const Frame& f, const PathFrame& p, int bounce, const Walk& w, Mask lit,
                   Clearance* clearance, Clearance* lamps, Point& at, Float* out) {
  at.patch = patch_of<3>(f, w.rays, w.hit, bits(lit), w.travelled);
  return light_point(f, p, bounce, w, lit, clearance, lamps, at, out);
}

// Light of the points that the paths of `lit` have reached, and the rays that they leave along.
// Out: lanes that go on; left: the geom of the points; aimed: light of glowing geoms and the sky.
inline Mask shade(const Frame& f, const PathFrame& p, int bounce, Walk& w, Mask lit,
                  Clearance* clearance, Clearance* lamps, Int& left, Float* aimed, Float* out) {
  const Rays& rays = w.rays;
  const Hit& hit = w.hit;
  const Sampler& sampler = w.sampler;
  Float zero = splat(0.0f);
  int draws = bounce * DRAWS;
  for (int c = 0; c < 3; c++) aimed[c] = zero;
  Point at;
  if (!arrive(f, p, bounce, w, lit, clearance, lamps, at, out)) return mask_of(0);
  const Patch<3>& patch = at.patch;
  const Scattering& s = at.scattering;
  // glowing geoms and the sky
  if (p.emitter_count > 0 || p.sky_share > 0) {
    Pair choice = pair_of(sampler, draws + DRAW_AIM), place = pair_of(sampler, draws + DRAW_PLACE);
    Mask to_sky = lit & (choice.x < p.sky_share);
    Mask to_emitter = lit & ~to_sky;
    Aim aim = {s.normal, zero, {zero, zero, zero}, zero};
    SkyPlace in_sky;
    if (p.emitter_count > 0 && any(to_emitter)) {
      aim = aim_at_emitter(f, p, patch.origin, choice.y, place, to_emitter,
                           w.travelled + hit.distance);
    }
    if (any(to_sky)) {
      Aim sky = aim_at_sky(f, p, place, in_sky);
      aim.towards = select(to_sky, sky.towards, aim.towards);
      aim.distance = select(to_sky, sky.distance, aim.distance);
      aim.density = select(to_sky, sky.density, aim.density);
    }
    Value v = evaluate(s, rays.direction, aim.towards);
    to_sky = to_sky & (v.density > 0.0f);
    if (any(to_sky)) {
      Float light[3];
      sky_light(f, p, in_sky, v.density, mask_of(0), bits(to_sky), light);
      for (int c = 0; c < 3; c++) aim.light[c] = select(to_sky, light[c], aim.light[c]);
    }
    Mask facing =
        lit & (aim.density > 0.0f) & (v.density > 0.0f) & (dot(aim.towards, patch.flat) > 0.0f);
    if (any(facing)) {
      // up to the glowing surface, not into it
      Float limit = aim.distance * 0.9999f;
      Float arrives =
          visibility(f, p, patch.origin, aim.towards, limit, hit.geom, facing, 0, clearance);
      Float weight = arrives / (v.density + aim.density);
      for (int c = 0; c < 3; c++) {
        aimed[c] = select(facing, v.light[c] * aim.light[c] * weight, zero);
      }
    }
  }
  for (int c = 0; c < 3; c++) {
    out[c] = select(lit, out[c] + w.carried[c] * (at.received[c] + aimed[c]), out[c]);
  }

  // onwards
  Pair lobe = pair_of(sampler, draws + DRAW_LOBE), way = pair_of(sampler, draws + DRAW_DIRECTION);
  Scattered next = scatter(s, rays.direction, lobe, way);
  Mask active = lit & next.alive & (dot(next.direction, patch.flat) > 0.0f);
  Float most = zero;
  for (int c = 0; c < 3; c++) {
    w.carried[c] = w.carried[c] * next.throughput[c];
    most = max(most, w.carried[c]);
  }
  active = active & (most > 0.0f);
  if (bounce >= SURE_BOUNCES) {
    Float survives = min(most, splat(0.95f));
    active = active & (pair_of(sampler, draws + DRAW_PASS).y < survives);
    Float inverse = 1.0f / max(survives, splat(1e-20f));
    for (int c = 0; c < 3; c++) w.carried[c] = w.carried[c] * inverse;
  }
  w.sure = next.mirrored;
  w.density = next.density;
  w.travelled = w.travelled + hit.distance;
  left = hit.geom;
  w.rays = {patch.origin, next.direction, false};
  return active;
}

}  // namespace
}  // namespace evs::EVS_SPACE
