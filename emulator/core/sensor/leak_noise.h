// Leak noise: the reference of a pixel sinks with time, so that it fires ON events without a
// signal.
#pragma once

#include <cstddef>

#include "sensor/comparator.h"
#include "sensor/pixel.h"

namespace evs {

// Leak of a pixel at this light: log units per us by which its reference sinks, a multiple of
// 2^-43. Parasitic leak is limited to one event a us, so that a pixel in the sun does not exhaust
// the memory.
EVS_ALWAYS_INLINE double leak_rate(const PixelStep& step, size_t pixel, float dn) {
  const double dark = step.pattern.leak[pixel];
  if (step.pattern.parasitic == nullptr) return dark;
  const double limit = step.pattern.theta_on[pixel];
  const double parasitic = step.pattern.parasitic[pixel] * (step.settings.parasitic_slope * dn);
  return dark + on_grid(parasitic < limit ? parasitic : limit);
}

// Apply the leak of the ticks in which the block was skipped, at the light of those ticks.
EVS_ALWAYS_INLINE void apply_skipped_leak(const PixelStep& step, size_t first, size_t count) {
  if (step.pattern.leak == nullptr) return;
  const double skipped_us =
      static_cast<double>(step.tick.begin_us - step.arrays.since_us[first / kBlock]);
  if (skipped_us == 0.0) return;
  const float* light =
      (step.settings.averages() ? step.arrays.running_mean.mean : step.arrays.last_luminance) +
      first;
  double* reference = step.arrays.reference + first;
  for (size_t i = 0; i < count; i++) {
    reference[i] -= leak_rate(step, first + i, to_dn(step.settings.map, light[i])) * skipped_us;
  }
}

}  // namespace evs
