// A block of pixels through one tick: light, running mean, log, filters, leak, comparators.
//
// Each term is a loop over the 64 pixels of a block, and a term that is off is a null pointer or a
// zero: no loop, no memory, no random number. A block in which nothing can happen is left out: its
// light has the same bits as in the last tick, its filters stand still, no pixel's leak or
// blindness ends in this tick, no noise comes. What it gives is what going through it would give.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "comparator.h"
#include "logmap.h"
#include "lowpass.h"
#include "running_mean.h"
#include "shot.h"

namespace evs {

inline constexpr size_t kBlock = 64;

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
  const float* theta_on = nullptr;   // at least 2^-8
  const float* theta_off = nullptr;  // at least 2^-8
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
  float lowpass_low;    // z at DN 0
  float lowpass_slope;  // z per DN
  LowpassStep follower;
  LowpassStep highpass;
  float follower_z;
  float highpass_z;
};

inline PixelStep begin_step(const PixelSettings& settings, const PixelPattern& pattern,
                            const PixelArrays& arrays, const double* shot_bounds, Tick tick) {
  const double us = tick.us;
  const float follower_z = static_cast<float>(settings.follower * us);
  const float highpass_z = static_cast<float>(settings.highpass * us);
  return {settings,
          pattern,
          arrays,
          shot_bounds,
          tick,
          static_cast<float>(settings.lowpass_low * us),
          static_cast<float>(settings.lowpass_slope * us),
          lowpass_step(follower_z),
          lowpass_step(highpass_z),
          follower_z,
          highpass_z};
}

// What the stages of one block hand to each other.
struct Scratch {
  alignas(64) float light[kBlock];  // luminance, the last good one where it is none
  alignas(64) float mean[kBlock];   // its running mean
  alignas(64) float dn[kBlock];
  alignas(64) float part[kBlock];
  alignas(64) float log[kBlock];         // log light at the end of the tick
  alignas(64) float from[kBlock];        // the signal at the start of the tick
  alignas(64) float to[kBlock];          // the signal at its end
  alignas(64) double reference[kBlock];  // at the start of the tick
  alignas(64) double drift[kBlock];
  alignas(64) int64_t loud[kBlock];
};

// Whether a pixel's light changed or is none.
EVS_ALWAYS_INLINE bool light_changed(const float* luminance, const float* last, size_t count) {
  uint32_t changed = 0;
  for (size_t i = 0; i < count; i++) {
    const uint32_t bits = std::bit_cast<uint32_t>(luminance[i]);
    const uint32_t unusable = bits >= 0x7f800000u ? 1u : 0u;
    changed |= (bits ^ std::bit_cast<uint32_t>(last[i])) | unusable;
  }
  return changed != 0;
}

// Luminance to log light. Out: how many pixels had no usable light; they keep their last.
template <LogKind kind>
EVS_ALWAYS_INLINE size_t to_log_light(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                      bool& moved) {
  const LogMap& map = step.settings.map;
  const float* luminance = step.tick.luminance + first;
  const float* last = step.arrays.last_luminance + first;
  const float* last_log = step.arrays.last_log + first;
  // each loop stores what the next one chooses from, so that no branch keeps the compiler from SIMD
  for (size_t i = 0; i < count; i++) s.dn[i] = to_dn(map, luminance[i]);
  uint32_t clamped = 0;
  const float largest = step.settings.average ? kLargestMean : kLargest;
  for (size_t i = 0; i < count; i++) {
    const bool usable = is_light(luminance[i], s.dn[i]) & (luminance[i] <= largest);
    s.light[i] = usable ? luminance[i] : last[i];
    clamped += usable ? 0u : 1u;
  }
  const float* light = s.light;
  if (step.settings.average) {
    moved |= average(step.arrays.average, s.light, last, first, count, s.mean);
    light = s.mean;
  }
  for (size_t i = 0; i < count; i++) s.dn[i] = to_dn(map, light[i]);
  for (size_t i = 0; i < count; i++) s.part[i] = log_part<kind>(map, s.dn[i]);
  for (size_t i = 0; i < count; i++) {
    const float log = with_log_part<kind>(map, s.dn[i], s.part[i]);
    s.log[i] = light[i] > -kBlack ? log : last_log[i];
  }
  return clamped;
}

// The signal that the comparators see, at the start and the end of the tick.
EVS_ALWAYS_INLINE void to_signal(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                 bool& moved) {
  const float* last_log = step.arrays.last_log + first;
  for (size_t i = 0; i < count; i++) {
    s.from[i] = last_log[i];
    s.to[i] = s.log[i];
  }
  uint32_t changed = 0;
  if (step.settings.lowpass()) {
    float* filtered = step.arrays.filtered + first;
    for (size_t i = 0; i < count; i++) {
      const float z = step.lowpass_low + step.lowpass_slope * s.dn[i];
      const bool begins = last_log[i] != last_log[i];
      const float y = filtered[i];
      const float exact = lowpass(lowpass_step(z), y, last_log[i], s.log[i]);
      const float euler = lowpass_euler(z, y, s.log[i]);
      const float next = step.settings.euler ? euler : exact;
      s.to[i] = begins ? s.log[i] : next;
      s.from[i] = begins ? s.log[i] : y;
      changed |= std::bit_cast<uint32_t>(s.to[i]) ^ std::bit_cast<uint32_t>(y);
    }
    for (size_t i = 0; i < count; i++) filtered[i] = s.to[i];
  }
  if (step.settings.follower > 0.0) {
    float* followed = step.arrays.followed + first;
    for (size_t i = 0; i < count; i++) {
      const bool begins = last_log[i] != last_log[i];
      const float y = followed[i];
      const float exact = lowpass(step.follower, y, s.from[i], s.to[i]);
      const float euler = lowpass_euler(step.follower_z, y, s.to[i]);
      const float next = step.settings.euler ? euler : exact;
      s.to[i] = begins ? s.log[i] : next;
      s.from[i] = begins ? s.log[i] : y;
      changed |= std::bit_cast<uint32_t>(s.to[i]) ^ std::bit_cast<uint32_t>(y);
    }
    for (size_t i = 0; i < count; i++) followed[i] = s.to[i];
  }
  moved |= changed != 0;
}

// Log units per us by which the reference of a pixel sinks at this light; a multiple of 2^-43.
EVS_ALWAYS_INLINE double leak_of(const PixelStep& step, size_t pixel, float dn) {
  const double dark = step.pattern.leak == nullptr ? 0.0 : step.pattern.leak[pixel];
  if (step.pattern.parasitic == nullptr) return dark;
  return dark + on_grid(step.pattern.parasitic[pixel] * (step.settings.parasitic_slope * dn));
}

// The reference at the start of the tick, and how far it sinks in it.
EVS_ALWAYS_INLINE void to_drift(const PixelStep& step, size_t first, size_t count, size_t block,
                                Scratch& s, bool& moved) {
  const double* reference = step.arrays.reference + first;
  for (size_t i = 0; i < count; i++) {
    s.reference[i] = reference[i];
    s.drift[i] = 0.0;
  }
  const double us = step.tick.us;
  if (step.pattern.leak != nullptr) {
    // ticks in which the block was left out have not leaked yet
    const double owed = static_cast<double>(step.tick.begin_us - step.arrays.since_us[block]);
    for (size_t i = 0; i < count; i++) {
      const double leak = leak_of(step, first + i, s.dn[i]);
      s.reference[i] = reference[i] - leak * owed;
      s.drift[i] = leak * us;
    }
  }
  if (step.settings.highpass > 0.0) {
    // the reference follows the signal: what is left of their distance is high-passed
    const double a = step.highpass.a;
    const double b = step.highpass.b;
    uint64_t changed = 0;
    for (size_t i = 0; i < count; i++) {
      const double from = s.from[i];
      const double near = a * (from - s.reference[i]) + b * (s.to[i] - from);
      const double rise = on_grid(near);
      const double drift = rise == rise ? s.drift[i] - rise : s.drift[i];
      changed |= std::bit_cast<uint64_t>(drift) ^ std::bit_cast<uint64_t>(s.drift[i]);
      s.drift[i] = drift;
    }
    moved |= changed != 0;
  }
}

// The tick's events of pixels that have crossed something, have no reference, or draw noise.
inline void compare(const PixelStep& step, size_t first, size_t count, Scratch& s,
                    const std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
  const PixelPattern& pattern = step.pattern;
  const PixelArrays& arrays = step.arrays;
  std::vector<ShotCandidate> own;
  for (size_t i = 0; i < count; i++) {
    if (s.loud[i] == 0) continue;
    const size_t pixel = first + i;
    if (s.from[i] != s.from[i] || arrays.last_log[pixel] != arrays.last_log[pixel]) {
      // the first light only sets the reference
      const double phase = pattern.phase == nullptr ? 0.0 : pattern.phase[pixel];
      s.reference[i] = on_grid(s.to[i] - phase);
      continue;
    }
    own.clear();
    for (const ShotCandidate& shot : shots) {
      if (shot.pixel == i) own.push_back(shot);
    }
    Comparators comparators;
    comparators.pixel = static_cast<uint32_t>(pixel);
    comparators.on = pattern.theta_on[pixel];
    comparators.off = pattern.theta_off[pixel];
    comparators.reference = s.reference[i];
    comparators.signal = s.from[i];
    comparators.span = static_cast<double>(s.to[i]) - static_cast<double>(s.from[i]);
    comparators.drift = s.drift[i];
    comparators.begin_us = step.tick.begin_us;
    comparators.tick = step.tick.us;
    comparators.refractory = step.settings.refractory;
    if (arrays.blind_until != nullptr) comparators.blind_until = arrays.blind_until[pixel];
    if (pattern.hot != nullptr && pattern.hot[pixel] != 0) comparators.drifting = Cause::hot;
    if (!own.empty()) {
      comparators.shot_on = step.settings.shot.on[pixel];
      comparators.shot_off = step.settings.shot.off[pixel];
      comparators.share = step.settings.shot.share(s.dn[i]);
    }
    comparators.run(own.data(), own.size(), out);
    s.reference[i] = comparators.reference;
    if (arrays.blind_until != nullptr) arrays.blind_until[pixel] = comparators.blind_until;
  }
}

// The last us, by the sensor's clock, until which nothing happens in a block whose light and
// filters stand still.
inline int64_t quiet_until(const PixelStep& step, size_t first, size_t count, const Scratch& s) {
  constexpr double kFar = 0x1p61;
  const int64_t end = step.tick.begin_us + step.tick.us;
  double soonest = kFar;
  int64_t sees = std::numeric_limits<int64_t>::max();
  for (size_t i = 0; i < count; i++) {
    const double r = s.reference[i];
    if (r != r) {
      const bool blind = step.arrays.blind_until != nullptr && s.to[i] == s.to[i];
      if (blind && step.arrays.blind_until[first + i] < sees) {
        sees = step.arrays.blind_until[first + i];
      }
      continue;
    }
    if (step.pattern.leak == nullptr) continue;
    const double leak = leak_of(step, first + i, s.dn[i]);
    const double theta = step.pattern.theta_on[first + i];
    const double wait = leak > 0.0 ? (r + theta - static_cast<double>(s.to[i])) / leak : kFar;
    soonest = wait < soonest ? wait : soonest;
  }
  // rounding of the division is below a us for waits of less than 2^50 us
  const int64_t leaks = soonest < 0x1p50 ? end + static_cast<int64_t>(soonest) - 2 : kNever;
  return leaks < sees ? leaks : sees - 1;
}

// Pixels [first, first + count) of one block. Out: how many of them had no usable light.
EVS_ALWAYS_INLINE size_t step_block(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                    std::vector<ShotCandidate>& shots, std::vector<Crossing>& out) {
  const PixelArrays& arrays = step.arrays;
  const size_t block = first / kBlock;
  const int64_t end_us = step.tick.begin_us + step.tick.us;
  const float* luminance = step.tick.luminance + first;
  float* last_luminance = arrays.last_luminance + first;

  shots.clear();
  if (arrays.shot.next != nullptr && arrays.shot.next[block] <= end_us * kShotUnits) {
    draw_candidates(step.settings.shot, {arrays.shot.next + block, arrays.shot.count + block},
                    block, count, step.shot_bounds[block], step.tick.begin_us, end_us, shots);
  }
  bool moved = light_changed(luminance, last_luminance, count);
  const bool due = arrays.due_us != nullptr && arrays.due_us[block] < end_us;
  if (!moved && !due && shots.empty()) return 0;

  const size_t clamped = step.settings.map.kind == LogKind::linlog
                             ? to_log_light<LogKind::linlog>(step, first, count, s, moved)
                             : to_log_light<LogKind::log_eps>(step, first, count, s, moved);
  to_signal(step, first, count, s, moved);
  to_drift(step, first, count, block, s, moved);

  // who has reached a level, or has no reference (a NaN is not quiet)
  const float* theta_on = step.pattern.theta_on + first;
  const float* theta_off = step.pattern.theta_off + first;
  int64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double value = static_cast<double>(s.to[i]) + s.drift[i];
    const bool quiet = (value < s.reference[i] + static_cast<double>(theta_on[i])) &
                       (value > s.reference[i] - static_cast<double>(theta_off[i]));
    s.loud[i] = quiet ? 0 : 1;
    any |= s.loud[i];
  }
  for (const ShotCandidate& shot : shots) any |= s.loud[shot.pixel] = 1;

  // `compare` leaves the reference of the tick's end, quiet pixels only sink
  double* reference = arrays.reference + first;
  if (any == 0) {
    for (size_t i = 0; i < count; i++) reference[i] = s.reference[i] - s.drift[i];
  } else {
    compare(step, first, count, s, shots, out);
    for (size_t i = 0; i < count; i++) {
      reference[i] = s.loud[i] != 0 ? s.reference[i] : s.reference[i] - s.drift[i];
    }
  }
  float* last_log = arrays.last_log + first;
  for (size_t i = 0; i < count; i++) last_log[i] = s.log[i];
  for (size_t i = 0; i < count; i++) last_luminance[i] = s.light[i];
  if (arrays.due_us != nullptr) {
    for (size_t i = 0; i < count; i++) s.reference[i] = reference[i];
    arrays.due_us[block] = moved ? end_us : quiet_until(step, first, count, s);
    arrays.since_us[block] = end_us;
  }
  return clamped;
}

// Pixels [first, last) in order, first a multiple of kBlock. Crossings are appended to `out`.
EVS_ALWAYS_INLINE size_t step_pixels(const PixelStep& step, size_t first, size_t last,
                                     std::vector<Crossing>& out) {
  Scratch scratch;
  std::vector<ShotCandidate> shots;
  size_t clamped = 0;
  for (; first < last; first += kBlock) {
    const size_t count = last - first < kBlock ? last - first : kBlock;
    // the whole blocks are the same code with a count that the compiler knows
    clamped += count == kBlock ? step_block(step, first, kBlock, scratch, shots, out)
                               : step_block(step, first, count, scratch, shots, out);
  }
  return clamped;
}

}  // namespace evs
