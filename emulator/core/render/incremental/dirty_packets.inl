// Dirty packets of `direct` under a still camera: find the packets that moving geoms or changing
// lights may affect, from what was recorded when each was traced. All 16 packets of a block at
// once.
#pragma once

#include "render/geometry/culling.inl"
#include "render/shading/lights.inl"
#include "scene/path_scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// The bounding cones of 16 packets.
struct RayConePacket {
  Vec center, axis;
  Float radius, length, cosine, sine;
};

EVS_INLINE BoundingSpherePacket load_spheres(const float (*b)[LANES]) {
  return {{load(b[0]), load(b[1]), load(b[2])}, load(b[3])};
}

// The test of `cone_may_touch` for a capsule: how near its axis comes to the cone's.
EVS_INLINE Mask cone_touches_capsule(const BoundingCapsule& capsule, const RayConePacket& cone) {
  Vec v = splat(capsule.center) - cone.center;
  Float along = dot(v, cone.axis), ahead = splat(0.0f);
  Vec across = v - cone.axis * along;
  if (capsule.half > 0) {
    Vec u = splat(capsule.axis);
    Float cosine = dot(u, cone.axis);
    Vec perpendicular = u - cone.axis * cosine;
    // 1e-5: nearly parallel lines, for which the radius leaves room
    Float s = -dot(across, perpendicular) / max(dot(perpendicular, perpendicular), splat(1e-5f));
    across = across + perpendicular * min(max(s, splat(-capsule.half)), splat(capsule.half));
    ahead = abs(cosine) * capsule.half;
  }
  Float reach = cone.radius + capsule.radius;
  Float end = reach + (abs(along) + ahead + reach) * 1e-5f;
  Float allowed = (along + ahead) * cone.sine + end;
  return (allowed >= 0.0f) &
         (dot(across, across) * (cone.cosine * cone.cosine) <= allowed * allowed) &
         (along + ahead >= -end) & (along - ahead <= cone.length + end);
}

// Bound all cones of `lanes` by one.
inline RayCone cone_around(const RayConePacket& cones, Mask lanes) {
  auto most = [&](Float x) { return reduce_max(select(lanes, x, splat(-T_INFINITY))); };
  BoundingBox centers = bounding_box(cones.center, 0.0f, lanes);
  RayCone cone = bounding_sphere(centers);
  cone.radius += most(cones.radius);
  cone.length = most(cones.length);
  int first = first_lane(to_bits(lanes));
  cone.axis =
      normalized({lane(cones.axis.x, first), lane(cones.axis.y, first), lane(cones.axis.z, first)});
  // add up the chords; the chord of a cone's opening is at most this
  Vec apart = cones.axis - splat(cone.axis);
  float chord = most(sqrt(dot(apart, apart)) + cones.sine * 2.0f / (cones.cosine + 1.0f));
  open_cone(cone, chord * chord);
  return cone;
}

// Find the cones of `tested` that a geom that moved may touch.
inline Mask touched_by_motion(const RayConePacket& cones, const SceneChange& change, Mask tested) {
  Mask found = mask_from_bits(0);
  if (change.bounds.radius < 0) return found;
  // reject the many packets that are far from everything that moved
  tested = tested &
           cone_touches_capsule({change.bounds.center, {}, 0, change.bounds.radius, 0, 0}, cones);
  if (!any(tested)) return found;
  RayCone around = cone_around(cones, tested);
  for (int k = 0; k < change.spheres.count; k += LANES) {
    for (unsigned near = cone_touches(change.spheres, k, around); near; near &= near - 1) {
      found = found | (tested & cone_touches_capsule(change.capsules[k + first_lane(near)], cones));
    }
  }
  return found;
}

// The shadow cones of 16 packets; see `shadow_cone`.
EVS_INLINE RayConePacket shadow_cones(const Light& light, const BoundingSpherePacket& from) {
  RayConePacket cone = {from.center, {}, from.radius, splat(T_INFINITY), splat(1.0f), splat(0.0f)};
  if (light.is_delta_direction()) {
    cone.axis = splat(scaled(light.direction, -1.0f));
  } else {
    Vec w = splat(light.position) - from.center;
    cone.length = sqrt(dot(w, w));
    cone.axis = w * (1.0f / max(cone.length, splat(1e-30f)));
  }
  return cone;
}

// The cones from spheres to a lamp, a sphere: they open where it is the larger one.
EVS_INLINE RayConePacket soft_shadow_cones(V3 position, float radius,
                                           const BoundingSpherePacket& from) {
  radius *= 1.0001f;
  Vec w = splat(position) - from.center;
  Float distance = sqrt(dot(w, w)), zero = splat(0.0f);
  Float opening = (splat(radius) - from.radius) / max(distance, splat(1e-30f));
  // a sphere that touches the lamp sees it in all directions
  Mask outside = distance > from.radius + radius;
  RayConePacket cone = {from.center, w * (1.0f / max(distance, splat(1e-30f))), {}, {}, {}, {}};
  cone.sine = select(outside, max(opening, zero), zero);
  cone.cosine = sqrt(1.0f - cone.sine * cone.sine);
  cone.radius = select(outside, from.radius, from.radius + (distance + radius));
  cone.length = distance + radius;
  return cone;
}

inline bool is_dark(const Light& light) {
  for (int c = 0; c < MAX_CHANNELS; c++) {
    if (light.ambient[c] != 0 || light.diffuse[c] != 0 || light.specular[c] != 0) return false;
  }
  return true;
}

// Find the lanes of `lit` whose light or shadow may have changed.
inline Mask lighting_changed(const Frame& f, const BoundingSpherePacket& places,
                             const SceneChange& change, Mask lit) {
  Mask found = mask_from_bits(0);
  for (int i = 0; i < f.light_count && any(lit & ~found); i++) {
    const Light& light = f.lights[i];
    if (change.lights && __builtin_memcmp(&light, change.lights + i, sizeof(Light)) != 0) {
      if (!is_dark(light)) found = found | (lit & light_reaches(light, places));
      const Light& before = change.lights[i];
      if (!is_dark(before)) found = found | (lit & light_reaches(before, places));
    }
    if (!light.castshadow || !f.shadows) continue;
    Mask reached = lit & ~found & light_reaches(light, places);
    if (!any(reached)) continue;
    if (change.soft && light.is_bulb()) {
      RayConePacket cones = soft_shadow_cones(light.position, light.radius, places);
      found = found | touched_by_motion(cones, *change.soft, reached);
    } else {
      found = found | touched_by_motion(shadow_cones(light, places), change, reached);
    }
  }
  for (int i = 0; i < change.emitter_count && any(lit & ~found); i++) {
    const BoundingSphere& s = change.emitters[i];
    RayConePacket cones = soft_shadow_cones(s.center, s.radius, places);
    found = found | touched_by_motion(cones, change, lit & ~found);
  }
  return found;
}

void find_dirty_packets(const Frame& f, const PacketBlock& b, const SceneChange& change,
                        DirtyPackets& dirty) {
  // load the recorded bounds
  Mask packets = mask_from_bits(b.packets);
  const auto& p = b.primary;
  const auto& m = b.mirror_rays;
  RayConePacket primary = {{load(p[0]), load(p[1]), load(p[2])},
                           {load(p[3]), load(p[4]), load(p[5])},
                           load(p[6]),
                           splat(T_INFINITY),
                           load(p[7]),
                           load(p[8])};
  BoundingSpherePacket primary_hits = load_spheres(b.primary_hits),
                       mirror_hits = load_spheres(b.mirror_hits);
  RayConePacket cone = {primary_hits.center, {load(m[0]), load(m[1]), load(m[2])},
                        load(m[3]),          splat(T_INFINITY),
                        load(m[4]),          load(m[5])};
  // retrace packets whose camera or mirror rays a moving geom may touch
  Mask primary_rays = touched_by_motion(primary, change, packets), retrace = primary_rays;
  Mask mirrors = packets & ~(retrace | (cone.radius < 0.0f));
  if (any(mirrors)) retrace = retrace | touched_by_motion(cone, change, mirrors);
  // relight packets whose light or shadow may change
  Mask relight = lighting_changed(f, primary_hits, change,
                                  packets & ~(retrace | (primary_hits.radius < 0.0f)));
  relight =
      relight | lighting_changed(f, mirror_hits, change,
                                 packets & ~(retrace | relight | (mirror_hits.radius < 0.0f)));
  dirty = {to_bits(primary_rays), to_bits(retrace), to_bits(relight & ~retrace)};
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
