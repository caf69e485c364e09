// Contrast-adaptive antialiasing: which pixels need all their samples, and those samples.
//
// One sample a pixel is enough where the light without textures (the channel `plain`) is a straight
// line over the neighbours: no edge, no shadow's rim, no highlight is near. Textures are filtered
// as wide as the pixel already. A pixel's weight rises while an edge is still outside it, where all
// samples and one show the same: nothing jumps as the edge moves in.
#pragma once

#include "integrators/direct_pixels.inl"

namespace evs::EVS_SPACE {
namespace {

constexpr float CONTRAST_LOW = 0.04f, CONTRAST_HIGH = 0.12f;  // of the bend, relative to the light
constexpr float CONTRAST_FLOOR = 1.0f / 255;  // luminance below which contrast fades: 1 DN

// The bend a - 2 b + c over opposite neighbours, in four directions. A NaN gives some weight.
void weigh(const float* const* neighbours, float* weight) {
  Float centre = load(neighbours[4]) * 2.0f, bend = splat(0.0f);
  for (int i = 0; i < 4; i++) {
    Float sides = load(neighbours[i]) + load(neighbours[8 - i]);
    Float light = (sides + centre) * 0.25f + CONTRAST_FLOOR;
    bend = max(bend, abs(sides - centre) / light);
  }
  Float w = (bend - CONTRAST_LOW) * (1.0f / (CONTRAST_HIGH - CONTRAST_LOW));
  store(weight, min(max(w, splat(0.0f)), splat(1.0f)));
}

// The samples of one pixel lie beside each other in the lanes, and those of the next pixel follow.
// They are added up one by one, so that a pixel's light does not depend on its company.
template <int CHANNELS>
void refine_packet(const Frame& f, int column, int row, unsigned pixels, float* luminance,
                   float* rgb, const Record* record) {
  const Hull& hull = f.primary[row * f.packet_columns + column];
  Notes notes;
  if (record) static_cast<Trail&>(notes) = *record->trail;
  float sum[PACKET] = {}, sums[PACKET][3] = {};
  int sample = 0;
  for (unsigned left = pixels; left;) {
    alignas(64) float x[LANES], y[LANES], grey[LANES], colour[3][LANES];
    int owner[LANES], used = 0;
    for (int i = 0; i < LANES; i++) {
      // the last sample stands in for the lanes that are left over
      if (!left) {
        x[i] = x[i - 1];
        y[i] = y[i - 1];
        continue;
      }
      int pixel = first_lane(left);
      owner[i] = pixel;
      used = i + 1;
      x[i] = static_cast<float>(column * PACKET_WIDTH + pixel % PACKET_WIDTH) + f.sample_x[sample];
      y[i] = static_cast<float>(row * PACKET_HEIGHT + pixel / PACKET_WIDTH) + f.sample_y[sample];
      if (++sample == f.samples) sample = 0, left &= left - 1;
    }
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays_through(f, load(x), load(y)), hull, mask_of((1u << used) - 1),
                             splat(0.0f), record ? &notes : nullptr, light);
    store(grey, luminance_of<CHANNELS>(f, light));
    for (int i = 0; i < used; i++) sum[owner[i]] += grey[i];
    if (CHANNELS < 3 || !rgb) continue;
    for (int c = 0; c < 3; c++) {
      store(colour[c], light[f.colour + c]);
      for (int i = 0; i < used; i++) sums[owner[i]][c] += colour[c][i];
    }
  }
  if (record) write_record(notes, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (unsigned left = pixels; left; left &= left - 1) {
    int pixel = first_lane(left);
    int x = column * PACKET_WIDTH + pixel % PACKET_WIDTH;
    int y = row * PACKET_HEIGHT + pixel / PACKET_WIDTH;
    long at = static_cast<long>(y) * f.width + x;
    luminance[pixel] = shaded(f, at, sum[pixel] * share);
    for (int c = 0; c < 3 && rgb; c++) {
      rgb[3 * pixel + c] = shaded(f, at, sums[pixel][c] * share);
    }
  }
}

void refine(const Frame& f, int column, int row, unsigned pixels, float* luminance, float* rgb,
            const Record* record) {
  switch (f.channels) {
    case 1:
      return refine_packet<1>(f, column, row, pixels, luminance, rgb, record);
    case 3:
      return refine_packet<3>(f, column, row, pixels, luminance, rgb, record);
    default:
      return refine_packet<4>(f, column, row, pixels, luminance, rgb, record);
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
