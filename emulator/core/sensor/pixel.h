// A block of pixels through one tick: light, running mean, log, filters, leak, comparators.
//
// Each term is a loop over the 64 pixels of a block, and a term that is off is a null pointer or a
// zero: no loop, no memory, no random number. A block in which nothing can happen is left out: its
// light has the same bits as in the last tick, its filters stand still, no pixel's leak or
// blindness ends in this tick, no noise comes. What it gives is what going through it would give.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "log_map.h"
#include "lowpass.h"
#include "running_mean.h"
#include "shot_noise.h"

namespace evs {

// What every pixel of a sensor has in common.
struct PixelSettings {
  LogMap map;
  bool euler = false;
  // bandwidth, as z = 2 pi f dt per us: z = (low + slope DN) us; both 0: no limit
  double lowpass_low = 0.0;
  double lowpass_slope = 0.0;
  double follower = 0.0;         // 2 pi f, 1 / us; 0: no second pole
  double highpass = 0.0;         // 2 pi f, 1 / us; 0: none
  double parasitic_slope = 0.0;  // leak grows by parasitic * this * DN; 0: none
  uint32_t refractory = 0;       // us
  float noise_gain = 0.0f;       // of the running mean
  float drift_gain = 0.0f;
  float least_gain = 0.0f;
  float noise_weight = 0.0f;
  bool average = false;  // the running mean is there
  bool causes = false;   // events say why they came about
  ShotNoise shot;        // its rates: of each pixel, below

  bool lowpass() const { return lowpass_low > 0.0 || lowpass_slope > 0.0; }
};

// The fixed pattern, row by row. Null: that term is off.
struct PixelPattern {
  const float* theta_on = nullptr;   // at least 2^-20
  const float* theta_off = nullptr;  // at least 2^-20
  const float* leak = nullptr;       // log units per us, multiples of 2^-43
  const float* parasitic = nullptr;  // the same, of bright light
  const float* phase = nullptr;      // log units by which the first reference lies below the light
  const uint8_t* hot = nullptr;      // 1: what its leak does is called hot
};

// The state of every pixel, row by row, all In/out. Null: that term is off.
struct PixelArrays {
  double* reference = nullptr;      // NaN: no light yet, or blind
  float* last_log = nullptr;        // NaN: no light yet
  float* last_luminance = nullptr;  // the last that was one; -1: none yet
  float* filtered = nullptr;        // after the first pole
  float* followed = nullptr;        // after the second
  int64_t* blind_until = nullptr;   // us of the sensor's clock
  RunningMean average;
  // of each block
  int64_t* due_us =
      nullptr;  // by the sensor's clock: nothing happens before, if light stands still
  int64_t* since_us = nullptr;  // by the sensor's clock: until then the leak is in the reference
  ShotClock shot{nullptr, nullptr};
};

struct Tick {
  const float* luminance;
  int64_t begin_us;  // by the sensor's clock: the sum of all ticks so far
  uint32_t us;
};

// Everything about a tick that no pixel changes.
struct PixelStep {
  const PixelSettings& settings;
  const PixelPattern& pattern;
  const PixelArrays& arrays;
  const double* shot_bounds;  // of each block
  Tick tick;
  float plain;          // light below this is usable whatever the settings
  float lowpass_low;    // z at DN 0
  float lowpass_slope;  // z per DN
  float follower_z;
  LowpassStep follower;
  LowpassStep highpass;
};

inline PixelStep begin_step(const PixelSettings& settings, const PixelPattern& pattern,
                            const PixelArrays& arrays, const double* shot_bounds, Tick tick) {
  // no denormal: what the workers make of one depends on the machine
  auto in_a_tick = [&](double rate) {
    return flush(static_cast<float>(rate * tick.us), std::numeric_limits<float>::min());
  };
  const float follower_z = in_a_tick(settings.follower);
  return {settings,
          pattern,
          arrays,
          shot_bounds,
          tick,
          is_light(kLargestMean, to_dn(settings.map, kLargestMean)) ? kLargestMean : 0.0f,
          in_a_tick(settings.lowpass_low),
          in_a_tick(settings.lowpass_slope),
          follower_z,
          lowpass_step(follower_z),
          lowpass_step(in_a_tick(settings.highpass))};
}

}  // namespace evs
