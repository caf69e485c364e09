#include "integrators/antialiasing.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT;
constexpr int TAPS = 4;  // texture taps in a pixel

float blend(float base, float refined, float weight) {
  return weight < 1 ? base + weight * (refined - base) : refined;
}

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
  f.samples = 1;
  f.sample_x = f.sample_y = &middle_;
  f.pixel_angle = base_angle_;
  f.channels++;
  // the taps are those of a pinhole's pixel; with a lens the mip level alone filters
  f.taps = frame.lens ? 1 : static_cast<int>(tap_x_.size());
  f.tap_x = tap_x_.data();
  f.tap_y = tap_y_.data();
  f.tap_width = 1.0f / std::sqrt(static_cast<float>(TAPS));
  float side = f.taps > 1 ? f.tap_width : 1.0f;
  f.pixel_x = base_x_ * side;
  f.pixel_y = base_y_ * side;
  if (f.probes > 0) f.probes = probes_of(std::max(f.taps, 1));
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
        PacketRecord record = {};
        if (rays) record = rays->record(first + g, row);
        kernel.refine(frame, first + g, row, missing, light, colour, rays ? &record : nullptr);
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
    int pixel = y[k] % PACKET_HEIGHT * PACKET_WIDTH + x[k] % PACKET_WIDTH;
    kernel.refine(frame, column, row, 1u << pixel, light, nullptr, nullptr);
    luminance[k] = blend(own[k], light[pixel], weight[k]);
  }
}

}  // namespace evs
