// An array of event pixels with their fixed pattern. One call per tick: luminance in, sorted events
// out. The caller owns the state.
#pragma once

#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include "event_order.h"
#include "pixel_targets.h"
#include "thread_pool.h"

namespace evs {

class PixelArray {
 public:
  // width and height are at most 32767; threads <= 0 means one for each core. The pattern must
  // outlive this object.
  PixelArray(const PixelSettings& settings, const PixelPattern& pattern, int width, int height,
             int threads, const std::string& isa)
      : settings_(settings),
        pattern_(pattern),
        width_(static_cast<uint32_t>(width)),
        pixels_(static_cast<size_t>(width) * static_cast<size_t>(height)),
        step_(choose_step(isa)),
        pool_(threads) {
    const size_t bands = (pixels_ + kBand - 1) / kBand;
    crossings_.resize(bands);
    clamped_.resize(bands);
    if (settings_.shot.on != nullptr) {
      for (size_t first = 0; first < pixels_; first += kBlock) {
        shot_bounds_.push_back(
            shot_bound(settings_.shot, first, std::min(kBlock, pixels_ - first)));
      }
    }
  }

  size_t pixels() const { return pixels_; }
  size_t blocks() const { return (pixels_ + kBlock - 1) / kBlock; }

  // Sorted events of the tick that begins at t_begin_us; tick.us < 2^28. Out: `clamped`, pixels
  // that kept their last value because their luminance was unusable.
  EventBuffer step(const PixelArrays& arrays, Tick tick, int64_t t_begin_us, size_t& clamped) {
    const PixelStep step = prepare_step(settings_, pattern_, arrays, shot_bounds_.data(), tick);
    // step the bands; they do not depend on the number of threads, and are merged in order
    pool_.run(static_cast<int>(crossings_.size()), [&](int band, int) {
      const size_t index = static_cast<size_t>(band);
      const size_t first = index * kBand;
      std::vector<Crossing>& out = crossings_[index];
      out.clear();
      clamped_[index] = step_(step, first, std::min(first + kBand, pixels_), out);
    });
    clamped = std::accumulate(clamped_.begin(), clamped_.end(), size_t{0});
    EventBuffer events = order_events(crossings_, t_begin_us, tick.us, width_, settings_.causes);

    // free the memory of a burst
    for (std::vector<Crossing>& out : crossings_) {
      if (out.capacity() > kBand * 4) std::vector<Crossing>().swap(out);
    }
    return events;
  }

 private:
  static constexpr size_t kBand = 8192;
  static_assert(kBand % kBlock == 0);

  PixelSettings settings_;
  PixelPattern pattern_;
  uint32_t width_;
  size_t pixels_;
  StepPixels step_;
  ThreadPool pool_;
  std::vector<double> shot_bounds_;               // of each block, Hz
  std::vector<std::vector<Crossing>> crossings_;  // scratch, of each band
  std::vector<size_t> clamped_;                   // scratch
};

}  // namespace evs
