// Entry points of `direct`: packets of pixels, with or without a record of their rays, and
// scattered pixels.
#pragma once

#include "geometry/camera.inl"
#include "integrators/direct.inl"
#include "integrators/film.inl"

namespace evs::EVS_NAMESPACE {
namespace {

template <int CHANNELS>
void trace_packet(const Frame& f, int column, int row, const Outputs& out,
                  const PacketRecord* record) {
  const RayCone& cone = PACKETS == 1 ? f.primary[row * f.packet_columns + column]
                                     : f.pairs[row * (f.packet_columns / 2) + column / 2];
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  RayRecorder recorder;
  if (record && record->shading.numbers) {
    recorder.shading = record->shading;
    *record->shading.geom = -1;
  }
  for (int s = 0; s < f.samples; s++) {
    Rays rays = primary_rays(f, column, row, f.sample_x[s], f.sample_y[s]);
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, cone, mask_from_bits(ALL_LANES), splat(0.0f),
                             record ? &recorder : nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    if (out.rgb || out.untextured) {
      for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
    }
  }
  if (record) write_record(recorder, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

inline void trace(const Frame& f, int column, int row, const Outputs& out,
                  const PacketRecord* record) {
  for_channels(f, [&]<int CHANNELS>() { trace_packet<CHANNELS>(f, column, row, out, record); });
}

// Trace scattered pixels. Their rays share the camera only, so their cone is wide.
template <int CHANNELS>
void trace_scattered(const Frame& f, const int32_t* x, const int32_t* y, int count,
                     float* luminance, float* untextured) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  Float sum = splat(0.0f), sum_untextured = sum;
  Mask all = mask_from_bits(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = rays_through(f, pixel_point(column, f.sample_x[s], PACKET_WIDTH),
                             pixel_point(row, f.sample_y[s], PACKET_HEIGHT));
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, ray_cone(rays.origin, rays.direction, all, T_INFINITY), all,
                             splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    sum_untextured = sum_untextured + light[CHANNELS - 1];
  }
  alignas(64) float out[LANES];
  store(out, sum * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) {
    luminance[i] = vignetted(f, static_cast<long>(y[i]) * f.width + x[i], out[i]);
  }
  if (!untextured) return;
  store(out, sum_untextured * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) untextured[i] = out[i];
}

inline void trace_pixels(const Frame& f, const int32_t* x, const int32_t* y, int count,
                         float* luminance, float* untextured) {
  for_channels(
      f, [&]<int CHANNELS>() { trace_scattered<CHANNELS>(f, x, y, count, luminance, untextured); });
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
