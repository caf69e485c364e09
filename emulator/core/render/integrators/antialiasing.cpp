#include "render/integrators/antialiasing.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr int TAPS = 8, PROBES = 4;  // texture taps in a pixel, and most probes of one

}  // namespace

Antialiasing::Antialiasing(const Optics& optics, const Sampling& sampling, bool rgb)
    : width_(optics.width),
      height_(optics.height),
      columns_(sampling.columns),
      rows_(sampling.rows),
      base_angle_(static_cast<float>(1.0 / std::sqrt(optics.fx * optics.fy))),
      base_x_(static_cast<float>(1.0 / optics.fx)),
      base_y_(static_cast<float>(1.0 / optics.fy)) {
  if (!optics.orthographic) {
    sample_points(TAPS, tap_x_, tap_y_);
    for (int i = 0; i < TAPS; i++) tap_x_[i] -= 0.5f, tap_y_[i] -= 0.5f;
  }
  size_t pixels = static_cast<size_t>(width_) * height_;
  size_t packets = static_cast<size_t>(rows_) * columns_;
  luminance_.resize(pixels);
  rgb_.resize(rgb ? 3 * pixels : 0);
  // rows are read 16 pixels at a time
  stride_ = (width_ + PACKET - 1) / PACKET * PACKET + 2;
  untextured_.resize(static_cast<size_t>(rows_ * PACKET_HEIGHT + 2) * stride_);
  refined_.resize(packets * PACKET);
  refined_rgb_.resize(rgb ? 3 * packets * PACKET : 0);
  known_.resize(packets);
  traced_.resize(packets);
}

Frame Antialiasing::base_frame(const Frame& frame) const {
  Frame f = frame;
  f.samples = f.cells = 1;
  f.sample_x = f.sample_y = &middle_;
  f.pixel_angle = base_angle_;
  f.channels++;
  f.marks_blended = f.outlines;
  f.edge_x = f.edge_y = nullptr;
  if (f.outlines) set_cells(1, f);
  // the taps are those of a pinhole's pixel; with a lens the mip level alone filters
  f.taps = frame.lens ? 1 : static_cast<int>(tap_x_.size());
  f.tap_x = tap_x_.data();
  f.tap_y = tap_y_.data();
  f.tap_width = 1.0f / std::sqrt(static_cast<float>(TAPS));
  float side = f.taps > 1 ? f.tap_width : 1.0f;
  f.pixel_x = base_x_ * side;
  f.pixel_y = base_y_ * side;
  if (f.probes > 0) f.probes = f.taps > 1 ? PROBES : probes_of(1);
  return f;
}

Outputs Antialiasing::base() {
  return {luminance_.data(), rgb_.empty() ? nullptr : rgb_.data(), untextured_.data(), stride_,
          nullptr};
}

void Antialiasing::traced(int column, int row) {
  size_t packet = static_cast<size_t>(row) * columns_ + column;
  known_[packet] = 0;
  traced_[packet] = 1;
}

void Antialiasing::close_margin() {
  for (int y = 1; y <= height_; y++) {
    float* row = untextured_.data() + y * stride_;
    row[0] = row[1];
    row[width_ + 1] = row[width_];
  }
  std::copy_n(untextured_.begin() + stride_, width_ + 2, untextured_.begin());
  std::copy_n(untextured_.begin() + height_ * stride_, width_ + 2,
              untextured_.begin() + (height_ + 1) * stride_);
}

// Was any packet in or around the group at column `first` traced?
bool Antialiasing::near_traced(int first, int row) const {
  int left = std::max(first - 1, 0), right = std::min(first + GROUP, columns_ - 1);
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows_ - 1); r++) {
    const uint8_t* flags = traced_.data() + static_cast<size_t>(r) * columns_;
    for (int c = left; c <= right; c++) {
      if (flags[c]) return true;
    }
  }
  return false;
}

void Antialiasing::finish_row(const Kernel& kernel, const Frame& frame, int row, const Outputs& out,
                              PacketCache* rays) {
  finish_row(kernel, row, out, [&](int column, int, unsigned pixels, float* luminance, float* rgb) {
    PacketRecord record = {};
    if (rays) record = rays->record(column, row);
    kernel.refine(frame, column, row, pixels, luminance, rgb, rays ? &record : nullptr);
    return true;
  });
}

void Antialiasing::next_tick() { std::fill(traced_.begin(), traced_.end(), uint8_t{0}); }

void Antialiasing::trace_pixels(const Kernel& kernel, const Frame& frame, const Frame& base,
                                const int32_t* x, const int32_t* y, int count,
                                float* luminance) const {
  float own[PACKET], ignored[PACKET], untextured[9][PACKET] = {}, weight[PACKET];
  const float* neighbours[9];
  for (int i = 0; i < 9; i++) {
    // clamp to the image
    int32_t near_x[PACKET], near_y[PACKET];
    for (int k = 0; k < count; k++) {
      near_x[k] = std::clamp(x[k] + i % 3 - 1, 0, width_ - 1);
      near_y[k] = std::clamp(y[k] + i / 3 - 1, 0, height_ - 1);
    }
    kernel.trace_pixels(base, near_x, near_y, count, i == 4 ? own : ignored, untextured[i]);
    neighbours[i] = untextured[i];
  }
  kernel.refinement_weight(neighbours, weight);
  for (int k = 0; k < count; k++) {
    luminance[k] = own[k];
    if (!(weight[k] > 0)) continue;
    float light[PACKET];
    int column = x[k] / PACKET_WIDTH, row = y[k] / PACKET_HEIGHT;
    int pixel = place_in_packet(x[k], y[k]);
    kernel.refine(frame, column, row, 1u << pixel, light, nullptr, nullptr);
    luminance[k] = blend(own[k], light[pixel], weight[k]);
  }
}

}  // namespace evs
