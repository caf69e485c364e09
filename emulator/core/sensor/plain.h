// A sensor of plain pixels: one call per tick, luminance in, sorted events out.
#pragma once

#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include "event_order.h"
#include "pixel_isa.h"
#include "pool.h"

namespace evs {

class PlainSensor {
 public:
  // width, height at most 32767; threads <= 0: one for each core.
  PlainSensor(const LogMap& map, int width, int height, int threads, const std::string& isa)
      : map_(map),
        width_(static_cast<uint32_t>(width)),
        pixels_(static_cast<size_t>(width) * static_cast<size_t>(height)),
        step_(map.kind == LogKind::linlog ? choose_step<LogKind::linlog>(isa)
                                          : choose_step<LogKind::log_eps>(isa)),
        pool_(threads) {
    const size_t bands = (pixels_ + kBand - 1) / kBand;
    crossings_.resize(bands);
    clamped_.resize(bands);
  }

  // Events of (t_begin_us, t_begin_us + tick_us], 0 < tick_us < 2^30. Out: `clamped`, how many
  // pixels kept their last value because their light was negative, NaN or Inf.
  EventBuffer step(const PixelArrays& pixels, int64_t t_begin_us, uint32_t tick_us,
                   size_t& clamped) {
    // bands do not depend on the number of threads, and are merged in their order
    pool_.run(static_cast<int>(crossings_.size()), [&](int band, int) {
      const size_t index = static_cast<size_t>(band);
      const size_t first = index * kBand;
      std::vector<Crossing>& out = crossings_[index];
      out.clear();
      clamped_[index] = step_(map_, pixels, first, std::min(first + kBand, pixels_), tick_us, out);
    });
    clamped = std::accumulate(clamped_.begin(), clamped_.end(), size_t{0});
    EventBuffer events = order_events(crossings_, t_begin_us, tick_us, width_);

    // a burst's memory is not kept for ever
    for (std::vector<Crossing>& out : crossings_) {
      if (out.capacity() > kBand * 4) std::vector<Crossing>().swap(out);
    }
    return events;
  }

 private:
  static constexpr size_t kBand = 8192;

  LogMap map_;
  uint32_t width_;
  size_t pixels_;
  StepPixels step_;
  Pool pool_;
  std::vector<std::vector<Crossing>> crossings_;  // scratch, one for each band
  std::vector<size_t> clamped_;                   // scratch
};

}  // namespace evs
