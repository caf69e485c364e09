// What can change packets while the camera stands: geoms that come near their rays, and lights that
// reach what they see. The 16 packets of a block at once, from what was noted when each was traced.
#pragma once

#include "geometry/culling.inl"
#include "path_scene.h"
#include "shading/lights.inl"

namespace evs::EVS_SPACE {
namespace {

// As Hull, of 16 packets.
struct Hulls {
  Vec center, axis;
  Float radius, length, cosine, sine;
};

EVS_INLINE Balls balls_of(const float (*b)[LANES]) {
  return {{load(b[0]), load(b[1]), load(b[2])}, load(b[3])};
}

// The test of `may_touch`, for a rod: how near its axis comes to the hull's.
EVS_INLINE Mask touched_by(const Rod& rod, const Hulls& hull) {
  Vec v = splat(rod.center) - hull.center;
  Float along = dot(v, hull.axis), ahead = splat(0.0f);
  Vec across = v - hull.axis * along;
  if (rod.half > 0) {
    Vec u = splat(rod.axis);
    Float cosine = dot(u, hull.axis);
    Vec aside = u - hull.axis * cosine;
    // 1e-5: of nearly parallel lines each point is as near as the others; the radius has room for
    // it
    Float s = -dot(across, aside) / max(dot(aside, aside), splat(1e-5f));
    across = across + aside * min(max(s, splat(-rod.half)), splat(rod.half));
    ahead = abs(cosine) * rod.half;
  }
  Float reach = hull.radius + rod.radius;
  Float end = reach + (abs(along) + ahead + reach) * 1e-5f;
  Float allowed = (along + ahead) * hull.sine + end;
  return (allowed >= 0.0f) &
         (dot(across, across) * (hull.cosine * hull.cosine) <= allowed * allowed) &
         (along + ahead >= -end) & (along - ahead <= hull.length + end);
}

// One hull around those of `lanes`.
inline Hull hull_around(const Hulls& hulls, Mask lanes) {
  auto most = [&](Float x) { return highest(select(lanes, x, splat(-FAR))); };
  Region centers = region_of(hulls.center, 0.0f, lanes);
  Hull hull = ball_of(centers);
  hull.radius += most(hulls.radius);
  hull.length = most(hulls.length);
  int first = first_lane(bits(lanes));
  hull.axis =
      normalized({lane(hulls.axis.x, first), lane(hulls.axis.y, first), lane(hulls.axis.z, first)});
  // chords add up; the chord of an opening is no longer than this
  Vec apart = hulls.axis - splat(hull.axis);
  float chord = most(sqrt(dot(apart, apart)) + hulls.sine * 2.0f / (hulls.cosine + 1.0f));
  open(hull, chord * chord);
  return hull;
}

// Those of `wanted` that something that moved may touch.
inline Mask touched(const Hulls& hulls, const Change& change, Mask wanted) {
  Mask found = mask_of(0);
  if (change.around.radius < 0) return found;
  // most packets are nowhere near anything that moved
  wanted = wanted & touched_by({change.around.center, {}, 0, change.around.radius, 0, 0}, hulls);
  if (!any(wanted)) return found;
  Hull all = hull_around(hulls, wanted);
  for (int k = 0; k < change.balls.count; k += LANES) {
    for (unsigned near = touching(change.balls, k, all); near; near &= near - 1) {
      found = found | (wanted & touched_by(change.rods[k + first_lane(near)], hulls));
    }
  }
  return found;
}

// As `shadow_hull`.
EVS_INLINE Hulls shadow_hulls(const Light& light, const Balls& from) {
  Hulls hull = {from.center, {}, from.radius, splat(FAR), splat(1.0f), splat(0.0f)};
  if (light.kind == DIRECTIONAL) {
    hull.axis = splat(scaled(light.direction, -1.0f));
  } else {
    Vec w = splat(light.position) - from.center;
    hull.length = sqrt(dot(w, w));
    hull.axis = w * (1.0f / max(hull.length, splat(1e-30f)));
  }
  return hull;
}

inline bool is_dark(const Light& light) {
  for (int c = 0; c < MAX_CHANNELS; c++) {
    if (light.ambient[c] != 0 || light.diffuse[c] != 0 || light.specular[c] != 0) return false;
  }
  return true;
}

// Those of `lit`, which are in these places, whose light or shadow may have changed.
inline Mask lit_anew(const Frame& f, const Balls& places, const Change& change, Mask lit) {
  Mask found = mask_of(0);
  for (int i = 0; i < f.light_count && any(lit & ~found); i++) {
    const Light& light = f.lights[i];
    if (change.lights && __builtin_memcmp(&light, change.lights + i, sizeof(Light)) != 0) {
      if (!is_dark(light)) found = found | (lit & in_reach(light, places));
      const Light& before = change.lights[i];
      if (!is_dark(before)) found = found | (lit & in_reach(before, places));
    }
    if (!light.castshadow || !f.shadows) continue;
    Mask shaded = touched(shadow_hulls(light, places), change, lit & ~found);
    if (any(shaded)) found = found | (shaded & in_reach(light, places));
  }
  return found;
}

void ask(const Frame& f, const RayBlock& b, const Change& change, Needs& needs) {
  Mask packets = mask_of(b.packets);
  const auto& p = b.primary;
  const auto& m = b.mirror;
  Hulls primary = {{load(p[0]), load(p[1]), load(p[2])},
                   {load(p[3]), load(p[4]), load(p[5])},
                   load(p[6]),
                   splat(FAR),
                   load(p[7]),
                   load(p[8])};
  Balls seen = balls_of(b.seen), mirrored = balls_of(b.mirrored);
  Hulls cone = {seen.center, {load(m[0]), load(m[1]), load(m[2])},
                load(m[3]),  splat(FAR),
                load(m[4]),  load(m[5])};
  Mask met = touched(primary, change, packets), whole = met;
  Mask mirrors = packets & ~(whole | (cone.radius < 0.0f));
  if (any(mirrors)) whole = whole | touched(cone, change, mirrors);
  Mask lamps = lit_anew(f, seen, change, packets & ~(whole | (seen.radius < 0.0f)));
  lamps =
      lamps | lit_anew(f, mirrored, change, packets & ~(whole | lamps | (mirrored.radius < 0.0f)));
  needs = {bits(met), bits(whole), bits(lamps & ~whole)};
}

}  // namespace
}  // namespace evs::EVS_SPACE
