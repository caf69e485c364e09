// An array of event pixels with their fixed pattern. One call per tick: luminance in, sorted events
// out. The caller owns the state.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/isa.h"
#include "base/thread_pool.h"
#include "sensor/events.h"
#include "sensor/pixel_block.h"

namespace evs {

// Pixels that a thread steps at a time.
inline constexpr size_t BAND = 8192;
static_assert(BAND % BLOCK_PIXELS == 0);

// Step what is left of pixels with photon noise, and bring the crossings of a band that begins at a
// pixel, which are all of `out`, into the order of its pixels.
inline void finish_noisy(const PixelStep& step, NoisyPixels& noisy, size_t first,
                         std::vector<Crossing>& out) {
  noisy.advance(step, noisy, 0, out);
  // by places in their blocks, then by blocks
  std::vector<Crossing> other(out.size());
  auto sort_by = [&](auto&& key) {
    size_t place[std::max(BAND / BLOCK_PIXELS, BLOCK_PIXELS) + 1] = {};
    for (const Crossing& crossing : out) place[key(crossing) + 1]++;
    for (size_t i = 1; i < std::size(place); i++) place[i] += place[i - 1];
    for (const Crossing& crossing : out) other[place[key(crossing)]++] = crossing;
    out.swap(other);
  };
  sort_by([&](const Crossing& crossing) { return (crossing.pixel - first) % BLOCK_PIXELS; });
  sort_by([&](const Crossing& crossing) { return (crossing.pixel - first) / BLOCK_PIXELS; });
}

using AdvanceNoisy = decltype(NoisyPixels::advance);

// Pixels [first, last) in order; first is a multiple of BLOCK_PIXELS. Appends crossings to `out`.
// Out: pixels with unusable luminance.
EVS_ALWAYS_INLINE size_t step_pixels(const PixelStep& step, size_t first, size_t last,
                                     AdvanceNoisy advance, std::vector<Crossing>& out) {
  Scratch scratch;
  BudgetScratch budgets;
  thread_local NoisyPixels noisy;
  noisy.clear();
  noisy.advance = advance;
  std::vector<ShotCandidate> shots;
  size_t clamped = 0;
  const size_t begin = first;
  for (; first < last; first += BLOCK_PIXELS) {
    const size_t count = last - first < BLOCK_PIXELS ? last - first : BLOCK_PIXELS;
    // whole blocks are compiled with a constant count
    clamped += count == BLOCK_PIXELS
                   ? step_block(step, first, BLOCK_PIXELS, scratch, budgets, noisy, shots, out)
                   : step_block(step, first, count, scratch, budgets, noisy, shots, out);
  }
  if (step.arrays.photon_noise()) finish_noisy(step, noisy, begin, out);
  return clamped;
}

// The pixel step compiled for each instruction set. All give the same bytes; only their speed
// differs.
using StepPixels = size_t (*)(const PixelStep&, size_t first, size_t last, std::vector<Crossing>&);

#if EVS_BUILT_PORTABLE || EVS_BUILT_NEON || EVS_BUILT_ONE_LANE
inline void advance_portable(const PixelStep& step, NoisyPixels& noisy, size_t at_most,
                             std::vector<Crossing>& out) {
  advance_noisy(step, noisy, at_most, out);
}
inline size_t step_portable(const PixelStep& step, size_t first, size_t last,
                            std::vector<Crossing>& out) {
  return step_pixels(step, first, last, advance_portable, out);
}
#endif

#if EVS_BUILT_AVX2
EVS_AVX2 inline void advance_avx2(const PixelStep& step, NoisyPixels& noisy, size_t at_most,
                                  std::vector<Crossing>& out) {
  advance_noisy(step, noisy, at_most, out);
}
EVS_AVX2 inline size_t step_avx2(const PixelStep& step, size_t first, size_t last,
                                 std::vector<Crossing>& out) {
  return step_pixels(step, first, last, advance_avx2, out);
}
#endif

#if EVS_BUILT_AVX512
EVS_AVX512 inline void advance_avx512(const PixelStep& step, NoisyPixels& noisy, size_t at_most,
                                      std::vector<Crossing>& out) {
  advance_noisy(step, noisy, at_most, out);
}
EVS_AVX512 inline size_t step_avx512(const PixelStep& step, size_t first, size_t last,
                                     std::vector<Crossing>& out) {
  return step_pixels(step, first, last, advance_avx512, out);
}
#endif

// The step of an instruction set; "auto" is the best that this machine runs. Throws
// std::invalid_argument for others.
inline StepPixels choose_step(const std::string& isa) {
  const std::vector<std::string> names = isa_available();
  const std::string wanted = isa == "auto" ? names.front() : isa;
  if (std::find(names.begin(), names.end(), wanted) == names.end()) {
    throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'; use auto");
  }
#if EVS_BUILT_AVX512
  if (wanted == "avx512") return step_avx512;
#endif
#if EVS_BUILT_AVX2
  if (wanted == "avx2") return step_avx2;
#endif
#if EVS_BUILT_NEON
  // the compiler's own vectors are those of NEON
  if (wanted == "neon") return step_portable;
#endif
#if EVS_BUILT_PORTABLE
  if (wanted == "portable") return step_portable;
#endif
#if EVS_BUILT_ONE_LANE
  // the source has no lanes
  if (wanted == "one_lane") return step_portable;
#endif
  throw std::logic_error("no pixels for instruction set '" + wanted + "'");
}

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
    const size_t bands = (pixels_ + BAND - 1) / BAND;
    crossings_.resize(bands);
    clamped_.resize(bands);
    if (pattern_.shot_on != nullptr) {
      for (size_t first = 0; first < pixels_; first += BLOCK_PIXELS) {
        const size_t count = std::min(BLOCK_PIXELS, pixels_ - first);
        shot_bounds_.push_back(shot_bound(pattern_.shot_on, pattern_.shot_off, first, count));
      }
    }
  }

  size_t pixels() const { return pixels_; }
  size_t blocks() const { return (pixels_ + BLOCK_PIXELS - 1) / BLOCK_PIXELS; }
  const PixelSettings& settings() const { return settings_; }
  const PixelPattern& pattern() const { return pattern_; }
  const std::vector<double>& shot_bounds() const { return shot_bounds_; }

  PixelStep prepare(const PixelArrays& arrays, const Tick& tick) const {
    return prepare_step(settings_, pattern_, arrays, shot_bounds_.data(), tick);
  }

  // Sorted events of the tick that begins at t_begin_us; tick.us < 2^28. Out: `clamped`, pixels
  // that kept their last value because their luminance was unusable.
  EventBuffer step(const PixelArrays& arrays, Tick tick, int64_t t_begin_us, size_t& clamped) {
    const PixelStep step = prepare(arrays, tick);
    // step the bands; they do not depend on the number of threads, and are merged in order
    pool_.run(static_cast<int>(crossings_.size()), [&](int band, int) {
      const size_t index = static_cast<size_t>(band);
      const size_t first = index * BAND;
      std::vector<Crossing>& out = crossings_[index];
      out.clear();
      clamped_[index] = step_(step, first, std::min(first + BAND, pixels_), out);
    });
    clamped = std::accumulate(clamped_.begin(), clamped_.end(), size_t{0});
    EventBuffer events = order_events(crossings_, t_begin_us, tick.us, width_, settings_.causes);

    // free the memory of a burst
    for (std::vector<Crossing>& out : crossings_) {
      if (out.capacity() > BAND * 4) std::vector<Crossing>().swap(out);
    }
    return events;
  }

  // Account for the ticks in which blocks were skipped, up to `clock_us`: leak and budgets as they
  // follow from the parameters of this array. Another one may then take the state over.
  void settle(const PixelArrays& arrays, int64_t clock_us) const {
    if (arrays.since_us == nullptr) return;
    const Tick tick{nullptr, clock_us, 1};
    const PixelStep step = prepare(arrays, tick);
    BudgetScratch budgets;
    for (size_t first = 0; first < pixels_; first += BLOCK_PIXELS) {
      const size_t count = std::min(BLOCK_PIXELS, pixels_ - first);
      use_up_skipped_budgets(step, first, count, budgets);
      apply_skipped_leak(step, first, count);
      arrays.since_us[first / BLOCK_PIXELS] = arrays.due_us[first / BLOCK_PIXELS] = clock_us;
    }
  }

 private:
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
