#include "render/integrators/edge_sampling.h"

#include <algorithm>

namespace evs {
namespace {

float blend(float base, float rest, float share) { return base * share + rest * (1.0f - share); }

}  // namespace

EdgeSampling::EdgeSampling(int width, int height, int samples, bool rgb)
    : width_(width),
      height_(height),
      words_((width + 31) / 32),
      samples_(samples),
      share_(static_cast<float>(base_samples(samples)) / static_cast<float>(samples)) {
  const size_t pixels = static_cast<size_t>(width) * height;
  base_.resize(pixels);
  rest_.resize(pixels);
  base_rgb_.resize(rgb ? 3 * pixels : 0);
  rest_rgb_.resize(rgb ? 3 * pixels : 0);
  geoms_.resize(pixels);
  columns_.resize(static_cast<size_t>(width + 2) * height);
  edges_.resize(static_cast<size_t>(words_) * height);
}

Outputs EdgeSampling::base() {
  return {base_.data(), base_rgb_.empty() ? nullptr : base_rgb_.data(), nullptr, 0, geoms_.data()};
}

Outputs EdgeSampling::rest() {
  return {rest_.data(), rest_rgb_.empty() ? nullptr : rest_rgb_.data(), nullptr, 0, nullptr};
}

Frame EdgeSampling::rest_frame(const Frame& base) const {
  Frame f = base;
  f.samples = samples_ - base.samples;
  return f;
}

PathFrame EdgeSampling::rest_paths(const PathFrame& base) const {
  PathFrame p = base;
  p.first_sample = base_samples(samples_);
  return p;
}

long EdgeSampling::find_edges(int y) {
  auto row = [&](int i) {
    return geoms_.data() + static_cast<size_t>(std::clamp(i, 0, height_ - 1)) * width_;
  };
  const int32_t *above = row(y - 1), *here = row(y), *below = row(y + 1);
  // 1 where the pixels above, here and below do not show the same geom alone
  uint8_t* mixed = columns_.data() + static_cast<size_t>(y) * (width_ + 2) + 1;
  for (int x = 0; x < width_; x++) {
    mixed[x] = (above[x] != here[x]) | (below[x] != here[x]) | (here[x] == MIXED_GEOMS);
  }
  mixed[-1] = mixed[0];
  mixed[width_] = mixed[width_ - 1];
  uint32_t* words = edges_.data() + static_cast<size_t>(y) * words_;
  long found = 0;
  for (int first = 0; first < width_; first += 32) {
    uint32_t word = 0;
    for (int x = first; x < std::min(first + 32, width_); x++) {
      const int left = std::max(x - 1, 0), right = std::min(x + 1, width_ - 1);
      const int edge = mixed[x - 1] | mixed[x] | mixed[x + 1] | (here[left] != here[x]) |
                       (here[right] != here[x]);
      word |= static_cast<uint32_t>(edge) << (x - first);
    }
    words[first / 32] = word;
    found += __builtin_popcount(word);
  }
  return found;
}

void EdgeSampling::combine(int y, const Outputs& out) const {
  const size_t begin = static_cast<size_t>(y) * width_;
  const uint32_t* words = edges_.data() + static_cast<size_t>(y) * words_;
  std::copy_n(base_.data() + begin, width_, out.luminance + begin);
  if (out.rgb) std::copy_n(base_rgb_.data() + 3 * begin, 3 * width_, out.rgb + 3 * begin);
  for (int word = 0; word < words_; word++) {
    for (uint32_t left = words[word]; left; left &= left - 1) {
      const size_t at = begin + static_cast<size_t>(32 * word + __builtin_ctz(left));
      out.luminance[at] = blend(base_[at], rest_[at], share_);
      for (size_t c = 3 * at; c < 3 * at + 3 && out.rgb; c++) {
        out.rgb[c] = blend(base_rgb_[c], rest_rgb_[c], share_);
      }
    }
  }
}

void EdgeSampling::trace_pixels(const Kernel& kernel, const Frame& frame, const PathFrame& paths,
                                PathBatch& batch, const int32_t* x, const int32_t* y, int count,
                                float* luminance) const {
  constexpr int MOST = 16;
  int32_t geoms[9][MOST];
  for (int i = 0; i < 9; i++) {
    int32_t near_x[MOST], near_y[MOST];
    for (int k = 0; k < count; k++) {
      near_x[k] = std::clamp(x[k] + i % 3 - 1, 0, width_ - 1);
      near_y[k] = std::clamp(y[k] + i / 3 - 1, 0, height_ - 1);
    }
    kernel.first_geoms(frame, paths, near_x, near_y, count, geoms[i]);
  }
  int32_t edge_x[MOST], edge_y[MOST], owner[MOST];
  int edges = 0;
  for (int k = 0; k < count; k++) {
    bool others = geoms[4][k] == MIXED_GEOMS;
    for (const int32_t* near : geoms) others = others || near[k] != geoms[4][k];
    if (!others) continue;
    edge_x[edges] = x[k];
    edge_y[edges] = y[k];
    owner[edges++] = k;
  }
  kernel.trace_path_pixels(frame, paths, batch, x, y, count, luminance);
  if (edges == 0) return;
  float rest[MOST];
  kernel.trace_path_pixels(rest_frame(frame), rest_paths(paths), batch, edge_x, edge_y, edges,
                           rest);
  for (int k = 0; k < edges; k++) {
    luminance[owner[k]] = blend(luminance[owner[k]], rest[k], share_);
  }
}

}  // namespace evs
