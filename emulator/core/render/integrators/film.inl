// The film: the pixels that belong to the lanes of a packet, and writing their light.
#pragma once

#include "render/geometry/camera.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Call with the frame's number of channels as a template argument.
template <class Call>
EVS_INLINE void for_channels(const Frame& f, Call call) {
  switch (f.channels) {
    case 1:
      return call.template operator()<1>();
    case 2:
      return call.template operator()<2>();
    case 3:
      return call.template operator()<3>();
    case 4:
      return call.template operator()<4>();
    default:
      return call.template operator()<5>();
  }
}

// Assign up to 16 pixels to the lanes. Unused lanes repeat the last pixel.
inline void fill_lanes(const int32_t* x, const int32_t* y, int count, int* column, int* row) {
  for (int i = 0; i < LANES; i++) {
    column[i] = x[i < count ? i : count - 1];
    row[i] = y[i < count ? i : count - 1];
  }
}

// Apply the lens's vignetting to a pixel, counted row by row.
inline float vignetted(const Frame& f, long pixel, float light) {
  if (!f.vignette) return light;
  // outside the image circle even infinite light is 0
  return f.vignette[pixel] > 0.0f ? light * f.vignette[pixel] : 0.0f;
}

template <int CHANNELS>
EVS_INLINE Float luminance_of(const Frame& f, const Float* light) {
  Float luminance = light[0] * f.weights[0];
  if (CHANNELS >= 3 && f.colour == 0) {
    luminance = luminance + light[1] * f.weights[1] + light[2] * f.weights[2];
  }
  return luminance;
}

// Write the pixels of the packets that lie in the image. In: luminance and light by channel,
// averaged over the samples.
template <int CHANNELS>
void write_pixels(const Frame& f, int column, int row, Float luminance, const Float* light,
                  const Outputs& out) {
  alignas(64) float grey[LANES], colour[3][LANES];
  store(grey, luminance);
  bool rgb = CHANNELS >= 3 && out.rgb;
  int x = column * PACKET_WIDTH, y = row * PACKET_HEIGHT;
  constexpr int WIDTH = PACKETS * PACKET_WIDTH;
  int columns = f.width - x < WIDTH ? f.width - x : WIDTH;
  int rows = f.height - y < PACKET_HEIGHT ? f.height - y : PACKET_HEIGHT;
  // copy luminance alone row by row
  if (columns == WIDTH && !rgb && !out.untextured && !f.vignette) {
    for (int j = 0; j < rows; j++) {
      float* to = out.luminance + static_cast<long>(y + j) * f.width + x;
      for (int p = 0; p < PACKETS; p++) {
        __builtin_memcpy(to + p * PACKET_WIDTH, grey + p * PACKET + j * PACKET_WIDTH,
                         PACKET_WIDTH * sizeof(float));
      }
    }
    return;
  }
  // write everything else pixel by pixel
  for (int c = 0; c < 3 && rgb; c++) store(colour[c], light[f.colour + c]);
  alignas(64) float untextured[LANES];
  if (out.untextured) store(untextured, light[CHANNELS - 1]);
  for (int j = 0; j < rows; j++) {
    long at = static_cast<long>(y + j) * f.width + x;
    for (int i = 0; i < columns; i++) {
      int l = i / PACKET_WIDTH * PACKET + j * PACKET_WIDTH + i % PACKET_WIDTH;
      out.luminance[at + i] = vignetted(f, at + i, grey[l]);
      for (int c = 0; c < 3 && rgb; c++) {
        out.rgb[3 * (at + i) + c] = vignetted(f, at + i, colour[c][l]);
      }
      if (out.untextured)
        out.untextured[(y + j + 1) * out.untextured_stride + (x + i + 1)] = untextured[l];
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
