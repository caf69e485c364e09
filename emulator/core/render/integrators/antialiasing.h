// Contrast-adaptive antialiasing around the wide kernels: the state between ticks, and the second
// pass, which traces all samples of the pixels near an edge.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "render/incremental/packet_cache.h"
#include "render/integrators/antialiasing_blend.h"
#include "scene/optics.h"
#include "scene/scene.h"

namespace evs {

class Antialiasing {
 public:
  // rgb: trace colour beside the luminance.
  Antialiasing(const Optics& optics, const Sampling& sampling, bool rgb);

  // The first pass: one sample a pixel, and the light without textures. In: the frame of the second
  // pass.
  Frame base_frame(const Frame& frame) const;
  Outputs base();
  // Mark a packet as traced by the first pass, which makes its refined pixels stale.
  void traced(int column, int row);

  // Call once between the passes.
  void close_margin();
  // Run the second pass on packet row `row`. Out: luminance, and rgb or null. rays: the packet
  // cache to record into, or null.
  void finish_row(const Kernel& kernel, const Frame& frame, int row, const Outputs& out,
                  PacketCache* rays);
  // The same, where refine(column, row, pixels, luminance, rgb) traces all samples of some pixels,
  // as Kernel::refine does. Returns whether all of them did (they return false to be called again).
  template <class Refine>
  bool finish_row(const Kernel& kernel, int row, const Outputs& out, const Refine& refine);
  // Call after both passes.
  void next_tick();

  // Trace at most 16 single pixels. The result is the same, without reading or writing any state.
  void trace_pixels(const Kernel& kernel, const Frame& frame, const Frame& base, const int32_t* x,
                    const int32_t* y, int count, float* luminance) const;

 private:
  static constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT;
  static constexpr int GROUP = 4;  // packets side by side, 16 pixels wide

  bool near_traced(int first, int row) const;

  int width_, height_, columns_, rows_;
  float base_angle_, base_x_, base_y_;
  float middle_ = 0.5f;
  std::vector<float> tap_x_, tap_y_;  // px from the pixel's centre
  long stride_;                       // of plain_
  std::vector<float> luminance_;      // (h, w) of the first pass
  std::vector<float> rgb_;            // (h, w, 3); empty: no colour
  std::vector<float> untextured_;     // (h + 2, stride) light without textures, margin of one pixel
  std::vector<float> refined_;        // (rows, columns, 16) mean of all samples, where `known_`
  std::vector<float> refined_rgb_;    // (rows, columns, 16, 3)
  std::vector<uint16_t> known_;       // (rows, columns) one bit a pixel
  std::vector<uint8_t> traced_;       // (rows, columns) by this tick's first pass
};

template <class Refine>
bool Antialiasing::finish_row(const Kernel& kernel, int row, const Outputs& out,
                              const Refine& refine) {
  bool complete = true;
  int top = row * PACKET_HEIGHT, bottom = std::min(top + PACKET_HEIGHT, height_);
  for (int first = 0; first < columns_; first += GROUP) {
    if (!near_traced(first, row)) continue;
    int left = first * PACKET_WIDTH, right = std::min(left + PACKET, width_);
    float weight[PACKET_HEIGHT][PACKET];
    uint16_t wanted[GROUP] = {};
    for (int y = top; y < bottom; y++) {
      const float* neighbours[9];
      for (int i = 0; i < 9; i++) {
        neighbours[i] = untextured_.data() + (y + i / 3) * stride_ + (left + i % 3);
      }
      kernel.refinement_weight(neighbours, weight[y - top]);
      long at = static_cast<long>(y) * width_ + left;
      std::copy_n(luminance_.data() + at, right - left, out.luminance + at);
      if (out.rgb) std::copy_n(rgb_.data() + 3 * at, 3 * (right - left), out.rgb + 3 * at);
      for (int i = 0; i < right - left; i++) {
        if (weight[y - top][i] > 0) {
          int bit = (y - top) * PACKET_WIDTH + i % PACKET_WIDTH;
          wanted[i / PACKET_WIDTH] |= static_cast<uint16_t>(1u << bit);
        }
      }
    }
    for (int g = 0; g < GROUP; g++) {
      if (!wanted[g]) continue;
      size_t packet = static_cast<size_t>(row) * columns_ + first + g;
      float* light = refined_.data() + packet * PACKET;
      float* colour = !rgb_.empty() ? refined_rgb_.data() + 3 * packet * PACKET : nullptr;
      unsigned missing = wanted[g] & ~static_cast<unsigned>(known_[packet]);
      if (missing) {
        if (!refine(first + g, row, missing, light, colour)) {
          complete = false;
          continue;
        }
        known_[packet] |= static_cast<uint16_t>(missing);
      }
      for (unsigned left_over = wanted[g]; left_over; left_over &= left_over - 1) {
        int pixel = __builtin_ctz(left_over);
        int x = g * PACKET_WIDTH + pixel % PACKET_WIDTH, y = pixel / PACKET_WIDTH;
        long at = static_cast<long>(top + y) * width_ + left + x;
        float w = weight[y][x];
        out.luminance[at] = blend(luminance_[at], light[pixel], w);
        for (int c = 0; c < 3 && out.rgb; c++) {
          out.rgb[3 * at + c] = blend(rgb_[3 * at + c], colour[3 * pixel + c], w);
        }
      }
    }
  }
  return complete;
}

}  // namespace evs
