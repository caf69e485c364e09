// When a membrane fires inside a tick.
#pragma once

#include <cmath>
#include <cstdint>

#include "sensor/comparator.h"

namespace evs {

// Stamp of spike `n`, 1 ..., in microseconds after the start of the tick. In: V there, I, and the
// threshold, V_on or -V_off.
//
// V is a line from d V to d V + I. What was at its threshold before is what a large step left: what
// it has beyond whole thresholds is the share of the tick that remains, so that the stamps of many
// pixels spread evenly.
EVS_ALWAYS_INLINE uint32_t spike_time(double leaked, double current, double threshold, int n,
                                      double tick_us) {
  const double level = n * threshold;
  const bool below = (threshold > 0.0 ? leaked < level : leaked > level) && current != 0.0;
  if (below) return crossing_time(level - leaked, current, tick_us);
  const double inside = leaked / threshold;
  return crossing_time(1.0 - (inside - std::floor(inside)), 1.0, tick_us);
}

}  // namespace evs
