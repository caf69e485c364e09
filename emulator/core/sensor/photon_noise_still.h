// The photon noise of pixels whose signal stands still (StillNoise): of those of a block through
// one tick, in the ticks in which their block was skipped, and for how long it brings no event.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "sensor/photon_noise.h"
#include "sensor/photon_noise_block.h"
#include "sensor/pixel_front_end.h"

namespace evs {

// The photon noise of a pixel at this light.
inline NoiseBand noise_at(const PixelSettings& settings, float dn) {
  const double photoreceptor =
      settings.lowpass() ? settings.lowpass_low + settings.lowpass_slope * dn : 0.0;
  return noise_band(photoreceptor, settings.follower, settings.photon.scale, dn);
}

inline NoiseDraws noise_draws(const PixelSettings& settings, size_t pixel) {
  return {hash(settings.photon.key, pixel + 1)};
}

// The photon noise of a still pixel from `from_us` on.
inline StillNoise still_noise(const PixelStep& step, size_t pixel, double signal, float dn,
                              int64_t from_us) {
  const double leak = step.pattern.leak == nullptr ? 0.0 : leak_rate(step, pixel, dn);
  return {noise_at(step.settings, dn),
          signal,
          step.pattern.theta_on[pixel],
          step.pattern.theta_off[pixel],
          leak,
          step.arrays.reference[pixel],
          from_us};
}

// Use up the budgets of still pixels of a block in this tick, given as bits. In: the references at
// its start. Out: those, as bits, that are left to NoisyComparators, and whose state is as before:
// with an event, without a reference or with more than one cell of time in the tick.
EVS_ALWAYS_INLINE uint64_t use_up_still(const PixelStep& step, size_t first, uint64_t pixels,
                                        const float* dn, Signal signal, const double* reference,
                                        BudgetScratch& b) {
  StillScratch& s = b.still;
  if (pixels == 0) return 0;
  const size_t count = pack_pixels(pixels, 8, b);
  for (size_t k = 0; k < count; k++) {
    const size_t i = b.pixel[k];
    b.packed_dn[k] = dn[i];
    b.theta_on[k] = step.pattern.theta_on[first + i];
    b.theta_off[k] = step.pattern.theta_off[first + i];
    s.signal[k] = signal.from[i];
    s.reference[k] = reference[i];
    s.leak[k] = step.pattern.leak == nullptr ? 0.0 : leak_rate(step, first + i, dn[i]);
  }
  const PixelSettings& settings = step.settings;
  const double low = settings.lowpass_low;
  const double slope = settings.lowpass_slope;
  const double follower = settings.follower;
  const double scale = settings.photon.scale;
  const int64_t begin_us = step.tick.begin_us;
  const double begin = static_cast<double>(begin_us);
  const double end = static_cast<double>(begin_us + step.tick.us);
  for (size_t k = 0; k < count; k++) {
    const double light = b.packed_dn[k];
    const StillNoise still(noise_band(low + slope * light, follower, scale, light), s.signal[k],
                           b.theta_on[k], b.theta_off[k], s.leak[k], s.reference[k], begin_us);
    const double cell = still.cell_at(begin);
    const double middle = cell + 0.5 * still.cell_us;
    s.slow[k] = still.band.slow;
    s.shift[k] = still.band.shift;
    s.cell_end[k] = cell + still.cell_us;
    s.on[0][k] = still.on_level(begin);
    s.on[1][k] = still.on_level(end);
    s.on_middle[k] = still.on_level(middle);
    s.off_middle[k] = still.off_level(middle);
  }
  uint64_t left = 0;
  for (size_t k = 0; k < b.packed; k++) {
    const size_t i = b.pixel[k];
    double& budget = step.arrays.noise_budget[first + i];
    const double rate = still_rate(s.slow[k], s.shift[k], s.on_middle[k], s.off_middle[k]);
    const double moving = still_loss(s.leak[k], s.on[1][k]) - still_loss(s.leak[k], s.on[0][k]);
    const double hazard = rate * (end - begin) + moving;
    if ((hazard < budget) & (end <= s.cell_end[k]) & (s.reference[k] == s.reference[k])) {
      budget -= hazard;
    } else {
      left |= uint64_t{1} << i;
    }
  }
  return left;
}

// For how long the budget of a still pixel lasts for certain, us after `end_us`. Longer than
// `soonest` counts for nothing.
EVS_CALL_ON_DEVICE inline double noise_lasts(const PixelStep& step, size_t pixel, double signal,
                                             float dn, int64_t end_us, double soonest) {
  const StillNoise still = still_noise(step, pixel, signal, dn, end_us);
  int64_t us = int64_t{1} << 24;
  while (us > 1024 && static_cast<double>(us >> 2) >= soonest) us >>= 2;
  for (; us > 500; us >>= 2) {
    const double bound = still.bound(static_cast<double>(end_us + us));
    if (bound < step.arrays.noise_budget[pixel]) return static_cast<double>(us);
  }
  return 0.0;
}

// Use up the budgets in the ticks in which the block was skipped, at the light and the references
// of those ticks.
EVS_ALWAYS_INLINE void use_up_skipped_budgets(const PixelStep& step, size_t first, size_t count,
                                              BudgetScratch& b) {
  const PixelArrays& arrays = step.arrays;
  if (!arrays.photon_noise()) return;
  const int64_t since_us = arrays.since_us[first / BLOCK_PIXELS];
  if (since_us == step.tick.begin_us) return;
  const double skipped_us = static_cast<double>(step.tick.begin_us - since_us);
  const float* light =
      (step.settings.averages() ? arrays.running_mean.mean : arrays.last_luminance) + first;
  const float* signal = (step.settings.follower > 0.0 ? arrays.followed : arrays.filtered) + first;
  const bool leaks = step.pattern.leak != nullptr;
  for (size_t i = 0; i < count; i++) b.packed_dn[i] = to_dn(step.settings.map, light[i]);
  for (size_t i = 0; i < count; i++) {
    b.still.leak[i] = leaks ? leak_rate(step, first + i, b.packed_dn[i]) * skipped_us : 0.0;
  }
  const NoiseReach reach = within_reach(step, first, count, b.packed_dn, {signal, signal},
                                        arrays.reference + first, b.still.leak, b);
  for (uint64_t left = reach.still | reach.moving; left != 0; left &= left - 1) {
    const size_t i = static_cast<size_t>(std::countr_zero(left));
    const size_t pixel = first + i;
    if (!(arrays.reference[pixel] == arrays.reference[pixel])) continue;
    const StillNoise still = still_noise(step, pixel, signal[i], b.packed_dn[i], since_us);
    still.run(step.tick.begin_us, arrays.noise_budget[pixel], noise_draws(step.settings, pixel));
  }
}

}  // namespace evs
