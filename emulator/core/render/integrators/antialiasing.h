// Contrast-adaptive antialiasing around the wide kernels: the state between ticks, and the second
// pass, which traces all samples of the pixels near an edge.
#pragma once

#include <cstdint>
#include <vector>

#include "incremental/packet_cache.h"
#include "optics.h"
#include "scene.h"

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
  // Call after both passes.
  void next_tick();

  // Trace at most 16 single pixels. The result is the same, without reading or writing any state.
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
  std::vector<float> rgb_;            // (h, w, 3); empty: no colour
  std::vector<float> untextured_;     // (h + 2, stride) light without textures, margin of one pixel
  std::vector<float> refined_;        // (rows, columns, 16) mean of all samples, where `known_`
  std::vector<float> refined_rgb_;    // (rows, columns, 16, 3)
  std::vector<uint16_t> known_;       // (rows, columns) one bit a pixel
  std::vector<uint8_t> traced_;       // (rows, columns) by this tick's first pass
};

}  // namespace evs
