// Packets whose rays go where they went, while a light or a shadow on them moves: what was seen and
// the light of the first lights is kept, the other lights shine anew.
#pragma once

#include "integrators/direct_pixels.inl"

namespace evs::EVS_SPACE {
namespace {

// In: kept, of the packet; in 32 lanes of two side by side, which show one geom and keep the light
// of as many lights.
template <int CHANNELS>
void relight_packets(const Frame& f, int column, int row, const Outputs& out,
                     const KeptPatch* kept) {
  auto number = [kept](int i) {
    alignas(64) float lanes[LANES];
    for (int p = 0; p < PACKETS; p++) {
      __builtin_memcpy(lanes + p * PACKET, kept[p].numbers + i * PACKET, PACKET * sizeof(float));
    }
    return load(lanes);
  };
  Rays rays = primary_rays(f, column, row, f.sample_x[0], f.sample_y[0]);
  Float zero = splat(0.0f);
  Hit hit = {number(0), splat(*kept->geom), splat(0), zero, zero};
  const Geom& g = f.geoms[*kept->geom];
  const Surface& s = f.surfaces[g.surface];
  // as patch_of
  Vec normal = {zero, zero, splat(1.0f)};
  if (g.shape != PLANE) normal = site_of(f, g, rays, hit, ALL_LANES).normal;
  Patch<CHANNELS> patch;
  patch.point = patch.origin = rays.origin + rays.direction * hit.distance;
  patch.normal = facing(to_camera(g.rotation, normal), rays.direction);
  patch.specular = splat(s.specular);
  patch.exponent = splat(s.exponent);
  Float light[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) {
    patch.albedo[c] = number(1 + c);
    patch.gloss_tint[c] = s.texture >= 0 ? patch.albedo[c] : splat(1.0f);
    light[c] = number(1 + CHANNELS + c);
  }
  Points points;
  add_lights<CHANNELS>(f, rays, hit, patch, points, mask_of(ALL_LANES), kept->lights, f.light_count,
                       light);
  if (f.air.fog) fog<CHANNELS>(f, hit.distance, light);
  write_pixels<CHANNELS>(f, column, row, luminance_of<CHANNELS>(f, light), light, out);
}

inline void relight(const Frame& f, int column, int row, const Outputs& out,
                    const KeptPatch* kept) {
  for_channels(f, [&]<int CHANNELS>() { relight_packets<CHANNELS>(f, column, row, out, kept); });
}

}  // namespace
}  // namespace evs::EVS_SPACE
