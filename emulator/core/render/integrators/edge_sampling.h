// More samples at the edges of geoms, for `path`: the state between ticks.
//
// Every pixel takes the first quarter of its samples. Where they, or those of a neighbour, do not
// all hit the same geom, the pixel takes the others too: few samples disagree most about how much
// of a pixel each side of an edge covers.
#pragma once

#include <cstdint>
#include <vector>

#include "scene/path_scene.h"
#include "scene/scene.h"

namespace evs {

class EdgeSampling {
 public:
  // samples: of a pixel at an edge. rgb: keep colour beside the luminance.
  EdgeSampling(int width, int height, int samples, bool rgb);

  // Samples of every pixel: a quarter, at least one.
  static int base_samples(int samples) { return samples < 4 ? 1 : samples / 4; }

  // The first pass, of every pixel, writes here.
  Outputs base();
  // Mark the pixels of an image row that are at an edge, after the first pass. Out: their number.
  long find_edges(int y);
  // (h, (width + 31) / 32) one bit per pixel at an edge.
  const uint32_t* edges() const { return edges_.data(); }
  // The second pass: of the other samples of pixels at an edge, in frames made of those of the
  // first.
  Frame rest_frame(const Frame& base) const;
  PathFrame rest_paths(const PathFrame& base) const;
  Outputs rest();
  // Write the light of an image row, after both passes. Out: luminance, and rgb or null.
  void combine(int y, const Outputs& out) const;

  // Trace at most 16 single pixels. The result is the same, without reading or writing any state.
  void trace_pixels(const Kernel& kernel, const Frame& frame, const PathFrame& paths,
                    PathBatch& batch, const int32_t* x, const int32_t* y, int count,
                    float* luminance) const;

 private:
  int width_, height_, words_, samples_;
  float share_;                             // of the samples that every pixel takes
  std::vector<float> base_, rest_;          // (h, w) luminance: means of the two passes
  std::vector<float> base_rgb_, rest_rgb_;  // (h, w, 3); empty: no colour
  std::vector<int32_t> geoms_;              // (h, w) of the first pass
  std::vector<uint8_t> columns_;            // (h, w + 2) scratch of find_edges
  std::vector<uint32_t> edges_;
};

}  // namespace evs
