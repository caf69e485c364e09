// What a packet records while it is traced, so that later ticks can prove it clean.
#pragma once

#include "render/geometry/ray_cone.inl"
#include "render/shading/surface_interaction.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct RayRecorder : SecondaryRayBounds {
  CachedShading shading = {nullptr, 0, nullptr};
};

inline void write_sphere(float (*to)[16], int i, const BoundingBox& box) {
  RayCone sphere = bounding_sphere(box);
  to[0][i] = sphere.center.x;
  to[1][i] = sphere.center.y;
  to[2][i] = sphere.center.z;
  to[3][i] = box.low.x > box.high.x ? -1.0f : sphere.radius + box.step;
}

inline void write_record(const SecondaryRayBounds& secondary, const PacketRecord& record) {
  *record.secondary = secondary;
  // mirror images are not cached
  if (record.shading.numbers && !(secondary.mirror_hits.low.x > secondary.mirror_hits.high.x))
    *record.shading.geom = -1;
  // bounding spheres of the hits
  PacketBlock& b = *record.block;
  int i = record.column;
  write_sphere(b.primary_hits, i, secondary.primary_hits);
  write_sphere(b.mirror_hits, i, secondary.mirror_hits);
  b.mirror_rays[3][i] = -1;
  // bounding cone of the mirror rays
  if (secondary.mirror_spread < 0) return;
  RayCone cone = {};
  cone.radius = b.primary_hits[3][i];
  open_cone(cone, secondary.mirror_spread);
  float parts[6] = {secondary.mirror_axis.x,
                    secondary.mirror_axis.y,
                    secondary.mirror_axis.z,
                    cone.radius,
                    cone.cosine,
                    cone.sine};
  for (int k = 0; k < 6; k++) b.mirror_rays[k][i] = parts[k];
}

// Do all lanes hit one opaque shape whose normals can be recomputed?
inline bool can_cache_shading(const Frame& f, const Hit& hit, Mask lit) {
  if (to_bits(lit) != ALL_LANES || f.lobes || f.normal_mapped || f.medium.haze) return false;
  int index = lane(hit.geom, 0);
  if (to_bits(hit.geom == splat(index)) != ALL_LANES) return false;
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  return g.mesh < 0 && !s.layered && s.normal_map < 0 && s.alpha >= 1;
}

// In: light of the first lights.
template <int CHANNELS>
void cache_shading(const Hit& hit, const SurfaceInteraction<CHANNELS>& interaction,
                   const Float* light, const CachedShading& to) {
  *to.geom = lane(hit.geom, 0);
  store(to.numbers, hit.distance);
  for (int c = 0; c < CHANNELS; c++) {
    store(to.numbers + (1 + c) * LANES, interaction.albedo[c]);
    store(to.numbers + (1 + CHANNELS + c) * LANES, light[c]);
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
