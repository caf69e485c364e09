// What a packet notes while it is traced, so that it need not be traced again before it has to.
#pragma once

#include "geometry/ray_cone.inl"
#include "scene.h"
#include "shading/surface_interaction.inl"

namespace evs::EVS_SPACE {
namespace {

struct Notes : Trail {
  KeptPatch keep = {nullptr, 0, nullptr};
};

inline void write_ball(float (*to)[16], int i, const Region& region) {
  Hull ball = ball_of(region);
  to[0][i] = ball.center.x;
  to[1][i] = ball.center.y;
  to[2][i] = ball.center.z;
  to[3][i] = region.low.x > region.high.x ? -1.0f : ball.radius + region.step;
}

inline void write_record(const Trail& trail, const Record& record) {
  *record.trail = trail;
  // mirrors are not kept
  if (record.patch.numbers && !(trail.mirrored.low.x > trail.mirrored.high.x))
    *record.patch.geom = -1;
  RayBlock& b = *record.block;
  int i = record.column;
  write_ball(b.seen, i, trail.seen);
  write_ball(b.mirrored, i, trail.mirrored);
  b.mirror[3][i] = -1;
  if (trail.mirror_spread < 0) return;
  Hull cone = {};
  cone.radius = b.seen[3][i];
  open(cone, trail.mirror_spread);
  float parts[6] = {trail.mirror_axis.x, trail.mirror_axis.y, trail.mirror_axis.z,
                    cone.radius,         cone.cosine,         cone.sine};
  for (int k = 0; k < 6; k++) b.mirror[k][i] = parts[k];
}

// Do all pixels show one shape that hides what is behind it, and can its normals be found again?
inline bool can_keep(const Frame& f, const Hit& hit, Mask lit) {
  if (bits(lit) != ALL_LANES || f.lobes || f.bumpy || f.air.haze) return false;
  int index = lane(hit.geom, 0);
  if (bits(hit.geom == splat(index)) != ALL_LANES) return false;
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  return g.mesh < 0 && !s.layered && s.normal_map < 0 && s.alpha >= 1;
}

// In: light, of the first lights.
template <int CHANNELS>
void store_patch(const Hit& hit, const Patch<CHANNELS>& patch, const Float* light,
                 const KeptPatch& to) {
  *to.geom = lane(hit.geom, 0);
  store(to.numbers, hit.distance);
  for (int c = 0; c < CHANNELS; c++) {
    store(to.numbers + (1 + c) * LANES, patch.albedo[c]);
    store(to.numbers + (1 + CHANNELS + c) * LANES, light[c]);
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
