// Contrast-adaptive antialiasing: the weight of each pixel's refinement, and the refined pixels.
//
// One sample a pixel suffices where the light without textures (the channel `untextured`) is linear
// over the neighbours: no edge, shadow boundary or highlight is near, and textures are already
// filtered over the pixel. The weight of a pixel rises while an edge is still outside it, where one
// sample and all samples agree, so nothing jumps when the edge moves in.
#pragma once

#include "render/integrators/direct.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr float CONTRAST_LOW = 0.04f,
                CONTRAST_HIGH = 0.12f;        // of the second difference, relative to the light
constexpr float CONTRAST_FLOOR = 1.0f / 255;  // luminance below which contrast fades: 1 DN

// Weigh by the second difference a - 2 b + c over opposite neighbours, in four directions. Where an
// outline is blended, which light below 0 marks, nothing is left to refine, there and across it. A
// NaN gives some weight.
inline void refinement_weight(const float* const* neighbours, float* weight) {
  Float own = load(neighbours[4]), centre = own * 2.0f, bend = splat(0.0f);
  for (int i = 0; i < 4; i++) {
    Float one = load(neighbours[i]), other = load(neighbours[8 - i]), sides = one + other;
    Float light = (sides + centre) * 0.25f + CONTRAST_FLOOR;
    Mask blended = (one < 0.0f) | (other < 0.0f);
    bend = select(blended, bend, max(bend, abs(sides - centre) / light));
  }
  Float w = (bend - CONTRAST_LOW) * (1.0f / (CONTRAST_HIGH - CONTRAST_LOW));
  store(weight, select(own < 0.0f, splat(0.0f), min(max(w, splat(0.0f)), splat(1.0f))));
}

// Trace all samples of some pixels. The samples of one pixel fill adjacent lanes, followed by those
// of the next pixel, and are summed one by one, so a pixel's light does not depend on the others.
template <int CHANNELS, class Shading>
void refine_packet(const Shading& shading, const Frame& f, int column, int row, unsigned pixels,
                   float* luminance, float* rgb, const PacketRecord* record) {
  const RayCone& cone = f.primary[row * f.packet_columns + column];
  RayRecorder recorder;
  if (record) static_cast<SecondaryRayBounds&>(recorder) = *record->secondary;
  float sum[PACKET] = {}, sums[PACKET][3] = {};
  int sample = 0;
  for (unsigned left = pixels; left;) {
    // fill the lanes with samples
    alignas(64) float x[LANES], y[LANES], grey[LANES], colour[3][LANES];
    int owner[LANES], used = 0;
    for (int i = 0; i < LANES; i++) {
      // unused lanes repeat the last sample
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
    // trace them and add each to its pixel
    Float light[CHANNELS];
    radiance<CHANNELS, 0>(shading, f, rays_through(f, load(x), load(y)), cone,
                          mask_from_bits((1u << used) - 1), splat(0.0f),
                          record ? &recorder : nullptr, light);
    shading.template sampled<CHANNELS>(light);
    store(grey, luminance_of<CHANNELS>(f, light));
    for (int i = 0; i < used; i++) sum[owner[i]] += grey[i];
    if (CHANNELS < 3 || !rgb) continue;
    for (int c = 0; c < 3; c++) {
      store(colour[c], light[f.colour + c]);
      for (int i = 0; i < used; i++) sums[owner[i]][c] += colour[c][i];
    }
  }
  // record the rays, write the mean of each pixel
  if (record) write_record(recorder, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (unsigned left = pixels; left; left &= left - 1) {
    int pixel = first_lane(left);
    int x = column * PACKET_WIDTH + pixel % PACKET_WIDTH;
    int y = row * PACKET_HEIGHT + pixel / PACKET_WIDTH;
    long at = static_cast<long>(y) * f.width + x;
    luminance[pixel] = vignetted(f, at, sum[pixel] * share);
    for (int c = 0; c < 3 && rgb; c++) {
      rgb[3 * pixel + c] = vignetted(f, at, sums[pixel][c] * share);
    }
  }
}

inline void refine(const Frame& f, int column, int row, unsigned pixels, float* luminance,
                   float* rgb, const PacketRecord* record) {
  switch (f.channels) {
    case 1:
      return refine_packet<1>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
    case 3:
      return refine_packet<3>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
    default:
      return refine_packet<4>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
