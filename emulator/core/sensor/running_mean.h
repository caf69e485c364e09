// The noise-adaptive running mean of luminance in front of the pixel (model `adaptive`).
// emulator/sensor/running_mean.py explains it, and has its constants and the same float32
// steps.
#pragma once

#include <cstddef>

#include "sensor/log_map.h"

namespace evs {

struct RunningMean {
  float* mean = nullptr;   // In/out: luminance; null: the term is off
  float* noise = nullptr;  // In/out: mean square of the difference between ticks
  float* drift = nullptr;  // In/out: mean of luminance - mean
  float noise_gain = 0.0f;
  float drift_gain = 0.0f;
  float least_gain = 0.0f;
  float noise_weight = 0.0f;
};

inline constexpr float LARGEST_MEAN = 0x1p60f;  // more is unusable: its square must stay a float
inline constexpr float LEAST_DRIFT = 0x1p-50f;  // less is 0: its square must stay a normal float
inline constexpr float LEAST_NOISE = 0x1p-100f;
inline constexpr float TINY_LIGHT = 0x1p-100f;  // avoids 0 / 0 where light has never changed

// Pixels [first, first + count). In: usable luminance of this tick, -1 before the first light, and
// of the last tick. Out: the mean in `out`; true if the state of a pixel changed.
EVS_ALWAYS_INLINE bool update_running_mean(const RunningMean& to, const float* __restrict luminance,
                                           const float* __restrict last, size_t first, size_t count,
                                           float* __restrict out) {
  float* __restrict mean = to.mean + first;
  float* __restrict noise = to.noise + first;
  float* __restrict drift = to.drift + first;
  uint32_t changed = 0;
  for (size_t i = 0; i < count; i++) {
    const float now = flush_to_zero(luminance[i], BLACK);
    // noise: mean square of the difference between ticks
    const float difference = now - flush_to_zero(last[i], BLACK);
    const float old_noise = noise[i];
    const float new_noise = flush_to_zero(
        old_noise + to.noise_gain * (difference * difference - old_noise), LEAST_NOISE);
    // drift: mean distance of the luminance from its mean
    const float old_mean = mean[i];
    const float distance = now - old_mean;
    const float old_drift = drift[i];
    const float new_drift =
        flush_to_zero(old_drift + to.drift_gain * (distance - old_drift), LEAST_DRIFT);
    // gain: the share of the drift that is signal
    const float signal = new_drift * new_drift;
    const float best = signal / (signal + to.noise_weight * new_noise + TINY_LIGHT);
    const float gain = best > to.least_gain ? best : to.least_gain;
    const float moved = flush_to_zero(old_mean + gain * distance, BLACK);

    // start from the first light, with no noise and no drift
    const bool begins = old_mean != old_mean;
    const float first_mean = luminance[i] > -BLACK ? now : old_mean;
    const float mean_out = begins ? first_mean : moved;
    const float noise_out = begins ? 0.0f : new_noise;
    const float drift_out = begins ? 0.0f : new_drift;
    changed |= std::bit_cast<uint32_t>(mean_out) ^ std::bit_cast<uint32_t>(old_mean);
    changed |= std::bit_cast<uint32_t>(noise_out) ^ std::bit_cast<uint32_t>(old_noise);
    changed |= std::bit_cast<uint32_t>(drift_out) ^ std::bit_cast<uint32_t>(old_drift);
    out[i] = mean_out;
    mean[i] = mean_out;
    noise[i] = noise_out;
    drift[i] = drift_out;
  }
  return changed != 0;
}

}  // namespace evs
