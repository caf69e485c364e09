// The entry points of one lane: a pixel at a time, where the wide code has a packet. Nothing is
// recorded or kept between ticks.
#pragma once

#include "render/integrators/antialiasing.inl"
#include "render/integrators/direct.inl"
#include "render/integrators/ground_truth.inl"
#include "render/integrators/hybrid.inl"
#include "render/integrators/wavefront.inl"
#include "render/irradiance/node_light.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// The ray through a point of a pixel, rounded as in its packet.
EVS_INLINE Rays pixel_ray(const Frame& f, int x, int y, float sub_x, float sub_y) {
  return rays_through(f, pixel_point(&x, sub_x, PACKET_WIDTH),
                      pixel_point(&y, sub_y, PACKET_HEIGHT));
}

// Write the light of a pixel, averaged over the samples, if it lies in the image.
template <int CHANNELS>
void write_pixel(const Frame& f, int x, int y, Float luminance, const Float* light,
                 const Outputs& out) {
  if (x >= f.width || y >= f.height) return;
  long at = static_cast<long>(y) * f.width + x;
  out.luminance[at] = vignetted(f, at, lane(luminance, 0));
  for (int c = 0; c < 3 && CHANNELS >= 3 && out.rgb; c++) {
    out.rgb[3 * at + c] = vignetted(f, at, lane(light[f.colour + c], 0));
  }
  if (out.untextured) {
    out.untextured[(y + 1) * out.untextured_stride + (x + 1)] = lane(light[CHANNELS - 1], 0);
  }
}

// trace_packet of one pixel.
template <int CHANNELS, class Shading>
void trace_pixel(const Shading& shading, const Frame& f, int x, int y, const Outputs& out) {
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  Mask all = mask_from_bits(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = pixel_ray(f, x, y, f.sample_x[s], f.sample_y[s]);
    RayCone cone = ray_cone(rays.origin, rays.direction, all, T_INFINITY);
    Float light[CHANNELS];
    radiance<CHANNELS, 0>(shading, f, rays, cone, all, splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
  }
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixel<CHANNELS>(f, x, y, sum * share, sums, out);
}

inline void trace_path_pixel(const Frame& f, const PathFrame& p, PathBatch& batch, int x, int y,
                             const Outputs& out) {
  auto place = [&](int, Int& column, Int& row) -> const RayCone* {
    column = splat(x);
    row = splat(y);
    return nullptr;
  };
  trace_packets(f, p, batch, 1, out.geoms, place, [&](int, const Float* mean, Int geom) {
    Outputs light = {out.luminance, out.rgb, nullptr, 0, nullptr};
    write_pixel<3>(f, x, y, luminance_of<3>(f, mean), mean, light);
    if (out.geoms) out.geoms[static_cast<long>(y) * f.width + x] = lane(geom, 0);
  });
}

inline void trace_truth_pixel(const Frame& f, int x, int y, const Truth& out) {
  Rays rays = pixel_ray(f, x, y, 0.5f, 0.5f);
  Mask all = mask_from_bits(ALL_LANES);
  RayCone cone = ray_cone(rays.origin, rays.direction, all, T_INFINITY);
  write_truth(f, rays, intersect(f, rays, cone, all, from(near_distance(f, rays.direction))), x, y,
              1, 1, out);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
