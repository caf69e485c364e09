// What `direct` is asked for: packets of pixels, with a record of their rays or without, and pixels
// from anywhere.
#pragma once

#include "geometry/camera.inl"
#include "integrators/direct.inl"
#include "integrators/film.inl"

namespace evs::EVS_SPACE {
namespace {

template <int CHANNELS>
void trace_packet(const Frame& f, int column, int row, const Outputs& out, const Record* record) {
  const Hull& hull = PACKETS == 1 ? f.primary[row * f.packet_columns + column]
                                  : f.pairs[row * (f.packet_columns / 2) + column / 2];
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  Notes notes;
  if (record && record->patch.numbers) {
    notes.keep = record->patch;
    *record->patch.geom = -1;
  }
  for (int s = 0; s < f.samples; s++) {
    Rays rays = primary_rays(f, column, row, f.sample_x[s], f.sample_y[s]);
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, hull, mask_of(ALL_LANES), splat(0.0f),
                             record ? &notes : nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    if (out.rgb || out.plain) {
      for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
    }
  }
  if (record) write_record(notes, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

inline void trace(const Frame& f, int column, int row, const Outputs& out, const Record* record) {
  for_channels(f, [&]<int CHANNELS>() { trace_packet<CHANNELS>(f, column, row, out, record); });
}

// Pixels from anywhere: their rays share no more than the camera, so their hull is wide.
template <int CHANNELS>
void trace_any(const Frame& f, const int32_t* x, const int32_t* y, int count, float* luminance,
               float* plain) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  Float sum = splat(0.0f), sum_plain = sum;
  Mask all = mask_of(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = rays_through(f, pixel_point(column, f.sample_x[s], PACKET_WIDTH),
                             pixel_point(row, f.sample_y[s], PACKET_HEIGHT));
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, hull_of(rays.origin, rays.direction, all, FAR), all,
                             splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    sum_plain = sum_plain + light[CHANNELS - 1];
  }
  alignas(64) float out[LANES];
  store(out, sum * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) {
    luminance[i] = shaded(f, static_cast<long>(y[i]) * f.width + x[i], out[i]);
  }
  if (!plain) return;
  store(out, sum_plain * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) plain[i] = out[i];
}

inline void trace_pixels(const Frame& f, const int32_t* x, const int32_t* y, int count,
                         float* luminance, float* plain) {
  for_channels(f, [&]<int CHANNELS>() { trace_any<CHANNELS>(f, x, y, count, luminance, plain); });
}

}  // namespace
}  // namespace evs::EVS_SPACE
