// Relighting: packets whose rays are clean but whose light or shadow changes. The first hit and the
// light of the first lights come from the cache; the other lights are evaluated again.
#pragma once

#include "render/integrators/direct.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// In: the packet's cached shading; in 32 lanes that of two adjacent packets, which show one geom
// and cache equally many lights.
template <int CHANNELS>
void relight_packets(const Frame& f, int column, int row, const Outputs& out,
                     const CachedShading* cached) {
  auto number = [cached](int i) {
    alignas(64) float lanes[LANES];
    for (int p = 0; p < PACKETS; p++) {
      __builtin_memcpy(lanes + p * PACKET, cached[p].numbers + i * PACKET, PACKET * sizeof(float));
    }
    return load(lanes);
  };
  // rebuild the first hit
  Rays rays = primary_rays(f, column, row, f.sample_x[0], f.sample_y[0]);
  Float zero = splat(0.0f);
  Hit hit = {number(0), splat(*cached->geom), splat(0), zero, zero};
  const Geom& g = f.geoms[*cached->geom];
  const Surface& s = f.surfaces[g.surface];
  // as in surface_interaction
  Vec normal = {zero, zero, splat(1.0f)};
  if (g.shape != PLANE) normal = local_hit(f, g, rays, hit, ALL_LANES).normal;
  SurfaceInteraction<CHANNELS> interaction;
  interaction.point = interaction.spawn_point = rays.origin + rays.direction * hit.distance;
  interaction.normal = face_forward(to_camera(g.rotation, normal), rays.direction);
  interaction.specular = splat(s.specular);
  interaction.exponent = splat(s.exponent);
  Float light[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) {
    interaction.albedo[c] = number(1 + c);
    interaction.specular_tint[c] = s.texture >= 0 ? interaction.albedo[c] : splat(1.0f);
    light[c] = number(1 + CHANNELS + c);
  }
  // add the lights that are not cached
  LazyBounds bounds;
  add_lights<CHANNELS>(f, rays, hit, interaction, bounds, mask_from_bits(ALL_LANES), cached->lights,
                       f.light_count, light);
  if (f.medium.fog) apply_fog<CHANNELS>(f, hit.distance, light);
  write_pixels<CHANNELS>(f, column, row, luminance_of<CHANNELS>(f, light), light, out);
}

inline void relight(const Frame& f, int column, int row, const Outputs& out,
                    const CachedShading* cached) {
  for_channels(f, [&]<int CHANNELS>() { relight_packets<CHANNELS>(f, column, row, out, cached); });
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
