// What a packet keeps under a still camera: all that its light is made of but for the light of the
// cache's nodes, which changes in every tick. Shading it again then takes neither rays nor textures.
#pragma once

#include "integrators/film.inl"
#include "irradiance/node_lattice.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Rows of a sample: 16 numbers each.
constexpr int KEPT_MASKS = 0;   // lanes, one bit each: lit, mirrors, blended; and the following
constexpr int KEPT_SHARE = 1;   // of the second cells
constexpr int KEPT_CELLS = 2;   // x, y and four nodes, twice
constexpr int KEPT_WEIGHT = 14;  // of the surface, in front of what shines through haze
constexpr int KEPT_LIGHT = 15;   // by channel: light of lamps, reflectance, mirror image, haze

// Writes the samples of a packet one by one.
struct KeptWriter {
  float* sample;  // the next one
  bool complete = true;
  int surfaces = 0;  // shaded for it so far
  int channels = 0;

  float* row(int i) const { return sample + i * PACKET; }
  float* light(int kind, int c) const { return row(KEPT_LIGHT + kind * channels + c); }
  int32_t* masks() const { return reinterpret_cast<int32_t*>(sample); }

  // A surface in `lit`: only the first one may read the cache, and nothing shines through it.
  template <int CHANNELS>
  void shaded(const CacheCells& cells, const Float* lamps, const Float* reflectance, Float alpha,
              Mask lit) {
    channels = CHANNELS;
    complete = complete && surfaces++ == 0 && !any(lit & (alpha < 1.0f));
    if (!complete) return;
    const int32_t lanes[4] = {static_cast<int32_t>(to_bits(lit)), 0,
                              static_cast<int32_t>(to_bits(cells.blended)), 0};
    __builtin_memcpy(masks(), lanes, sizeof lanes);
    store(row(KEPT_SHARE), cells.share);
    keep_cells(cells.first, KEPT_CELLS);
    keep_cells(cells.second, KEPT_CELLS + 6);
    for (int c = 0; c < CHANNELS; c++) {
      store(light(0, c), lamps[c]);
      store(light(1, c), reflectance[c]);
    }
  }
  void keep_cells(const CellLanes& cells, int first) {
    store(row(first), cells.x);
    store(row(first + 1), cells.y);
    for (int k = 0; k < 4; k++) store(row(first + 2 + k), as_float(cells.node[k]));
  }
  // A mirror image that reads nothing, in `lanes`.
  template <int CHANNELS>
  void mirrored(const Float* image, Mask lanes) {
    if (!complete || surfaces != 1) return;
    masks()[1] = static_cast<int32_t>(to_bits(lanes));
    for (int c = 0; c < CHANNELS; c++) store(light(2, c), image[c]);
  }
  // How the surface is composited: over light that is in front of it, and that of lanes that miss.
  template <int CHANNELS>
  void composited(const Float* before, Float weight, Mask lit) {
    if (!complete || surfaces != 1) return;
    Mask plain = lit & (weight >= 1.0f);
    for (int c = 0; c < CHANNELS; c++) {
      plain = plain & (before[c] <= 0.0f) & (before[c] >= 0.0f);
      store(light(3, c), before[c]);
    }
    masks()[3] = to_bits(plain) != ALL_LANES;
    store(row(KEPT_WEIGHT), weight);
  }
  // The end of a sample, with all of its light.
  template <int CHANNELS>
  void sampled(const Float* total) {
    channels = CHANNELS;
    if (surfaces == 0) {
      const int32_t lanes[4] = {0, 0, 0, 1};
      __builtin_memcpy(masks(), lanes, sizeof lanes);
      for (int c = 0; c < CHANNELS; c++) store(light(3, c), total[c]);
    }
    surfaces = 0;
    sample += kept_rows(CHANNELS) * PACKET;
  }
};

// Which channel holds what: red, green and blue are `colour` ... `colour` + 2, all others are
// luminance.
template <int CHANNELS>
EVS_INLINE Float of_channel(const Frame& f, const Received& light, int c) {
  int k = c - f.colour;
  bool colour = CHANNELS >= 3 && k >= 0 && k < 3;
  return colour ? light.colour[k < 0 || k > 2 ? 0 : k] : light.luminance;
}

// The light of a packet with what it has kept, as trace_hybrid finds it.
template <int CHANNELS>
void relight_kept(const Frame& f, const IrradianceView& cache, int column, int row,
                  const Outputs& out, const float* rows) {
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  for (int s = 0; s < f.samples; s++, rows += kept_rows(CHANNELS) * PACKET) {
    auto kept = [rows](int i) { return load(rows + i * PACKET); };
    auto of = [&](int kind, int c) { return kept(KEPT_LIGHT + kind * CHANNELS + c); };
    uint32_t masks[4];
    __builtin_memcpy(masks, rows, sizeof masks);
    Mask lit = mask_from_bits(masks[0]), mirror = mask_from_bits(masks[1]);
    Float light[CHANNELS];
    if (masks[0]) {
      auto cells = [&](int i) {
        CellLanes at = {{}, kept(i), kept(i + 1)};
        for (int k = 0; k < 4; k++) at.node[k] = as_int(kept(i + 2 + k));
        return at;
      };
      CacheCells at;
      at.first = cells(KEPT_CELLS);
      at.blended = mask_from_bits(masks[2]);
      at.share = splat(0.0f);
      if (masks[2]) {
        at.share = kept(KEPT_SHARE);
        at.second = cells(KEPT_CELLS + 6);
      }
      Received received = {};
      read_cells<(CHANNELS >= 3)>(cache, at, lit, received);
      for (int c = 0; c < CHANNELS; c++)
        light[c] = of(0, c) + of(1, c) * of_channel<CHANNELS>(f, received, c);
      for (int c = 0; c < CHANNELS && masks[1]; c++)
        light[c] = select(mirror, light[c] + of(2, c), light[c]);
    }
    for (int c = 0; c < CHANNELS; c++) {
      if (!masks[3]) {
        light[c] = splat(0.0f) + light[c];
      } else if (masks[0]) {
        light[c] = select(lit, of(3, c) + light[c] * kept(KEPT_WEIGHT), of(3, c));
      } else {
        light[c] = of(3, c);
      }
      if (out.rgb || out.untextured) sums[c] = sums[c] + light[c];
    }
    sum = sum + luminance_of<CHANNELS>(f, light);
  }
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

inline void relight_hybrid(const Frame& f, const IrradianceView& cache, int column, int row,
                           const Outputs& out, const float* rows) {
  for_channels(f,
               [&]<int CHANNELS>() { relight_kept<CHANNELS>(f, cache, column, row, out, rows); });
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
