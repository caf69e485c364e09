// Contrast-adaptive antialiasing around the wide kernels: what is kept from tick to tick, and the
// second pass, which gives the pixels near an edge all their samples.
#pragma once

#include <cstdint>
#include <vector>

#include "incremental/packet_cache.h"
#include "optics.h"
#include "scene.h"

namespace evs {

class Antialiasing {
 public:
  // rgb: colour is carried beside the luminance.
  Antialiasing(const Optics& optics, const Sampling& sampling, bool rgb);

  // The first pass: one sample a pixel, and the light without textures. In: the frame of the
  // second.
  Frame base_frame(const Frame& frame) const;
  Outputs base();
  // A packet was traced by the first pass: its refined pixels are too old.
  void traced(int column, int row);

  // Between the passes, once.
  void close_margin();
  // The second pass, packet row `row`. Out: luminance and rgb or null. rays: what is kept of
  // them, or null.
  void finish_row(const Kernel& kernel, const Frame& frame, int row, const Outputs& out,
                  RayBlocks* rays);
  // After both.
  void next_tick();

  // Single pixels, at most 16: the same light, from nothing that is kept.
  void trace_pixels(const Kernel& kernel, const Frame& frame, const Frame& base, const int32_t* x,
                    const int32_t* y, int count, float* luminance) const;

 private:
  static constexpr int GROUP = 4;  // packets side by side, 16 pixels wide

  bool near_traced(int first, int row) const;

  int width_, height_, columns_, rows_;
  float base_angle_, base_x_, base_y_;
  float middle_ = 0.5f;
  std::vector<float> tap_x_, tap_y_;  // px from the pixel's centre
  long stride_;                       // of plain_
  std::vector<float> luminance_;      // (h, w) of the first pass
  std::vector<float> rgb_;            // (h, w, 3); empty: not wanted
  std::vector<float> plain_;          // (h + 2, stride) light without textures, margin of one pixel
  std::vector<float> refined_;        // (rows, columns, 16) mean of all samples, where `known_`
  std::vector<float> refined_rgb_;    // (rows, columns, 16, 3)
  std::vector<uint16_t> known_;       // (rows, columns) one bit a pixel
  std::vector<uint8_t> traced_;       // (rows, columns) by this tick's first pass
};

}  // namespace evs
