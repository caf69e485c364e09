// The front end of a block of pixels, before the comparators: running mean, log intensity,
// photoreceptor and source follower bandwidth, leak and high pass.
//
// Each term is a loop over the 64 pixels of a block. Loops load both sides of a choice before they
// choose and never store to what they load, so that the compiler vectorises them.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "sensor/comparator.h"
#include "sensor/pixel.h"
#include "sensor/response.h"

namespace evs {

// Intermediate values of one block.
struct Scratch {
  alignas(64) float luminance[BLOCK_PIXELS];  // the last usable one where it is unusable
  const float* usable;                        // all of it: `luminance`, or that of the tick
  alignas(64) float mean[BLOCK_PIXELS];       // its running mean
  alignas(64) float dn[BLOCK_PIXELS];
  alignas(64) float log_part[BLOCK_PIXELS];
  alignas(64) float a[BLOCK_PIXELS];  // LowpassStep at the light of each pixel
  alignas(64) float b[BLOCK_PIXELS];
  alignas(64) float lag[BLOCK_PIXELS];         // of the follower behind a photoreceptor
  alignas(64) float log[BLOCK_PIXELS];         // log intensity at the end of the tick
  alignas(64) float from[2][BLOCK_PIXELS];     // output of each filter at the start of the tick
  alignas(64) double reference[BLOCK_PIXELS];  // at the start of the tick
  alignas(64) double drift[BLOCK_PIXELS];      // by how much it sinks in the tick
};

// The luminance of a block, compared with the last tick.
struct LuminanceCheck {
  bool changed;  // of some pixel, or it is unusable
  bool safe;     // all of it is in [0, safe_below)
};

EVS_ALWAYS_INLINE LuminanceCheck check_luminance(const float* luminance, const float* last,
                                                 float safe_below, size_t count) {
  uint32_t changed = 0;
  uint32_t largest = 0;
  for (size_t i = 0; i < count; i++) {
    const uint32_t bits = std::bit_cast<uint32_t>(luminance[i]);
    largest = bits > largest ? bits : largest;
    changed |= bits ^ std::bit_cast<uint32_t>(last[i]);
  }
  // the bits of luminance have its order; those of negative values and NaN come after them
  return {changed != 0 || largest >= 0x7f800000u, largest < std::bit_cast<uint32_t>(safe_below)};
}

// Luminance to log intensity. In/out: `changed`, whether the state of the block changes. Out:
// pixels with unusable luminance, which keep their last one.
template <LogKind KIND>
EVS_ALWAYS_INLINE size_t log_intensity(const PixelStep& step, size_t first, size_t count,
                                       Scratch& s, bool safe, bool& changed) {
  const LogMap map = step.settings.map;
  const float* __restrict luminance = step.tick.luminance + first;
  s.usable = luminance;
  const float* __restrict last = step.arrays.last_luminance + first;
  const float* __restrict last_log = step.arrays.last_log + first;
  const float largest = step.settings.averages() ? LARGEST_MEAN : LARGEST;
  // all luminance is usable: only map it
  if (safe && !step.settings.averages()) {
    for (size_t i = 0; i < count; i++) s.dn[i] = to_dn(map, luminance[i]);
    for (size_t i = 0; i < count; i++) s.log_part[i] = log_part<KIND>(map, s.dn[i]);
    for (size_t i = 0; i < count; i++) s.log[i] = with_log_part<KIND>(map, s.dn[i], s.log_part[i]);
    return 0;
  }
  // replace unusable luminance by the last one
  uint32_t clamped = 0;
  for (size_t i = 0; i < count; i++) {
    const float new_luminance = luminance[i];
    const float old_luminance = last[i];
    const float dn = to_dn(map, new_luminance);
    const bool usable = is_usable(new_luminance, dn) & (new_luminance <= largest);
    s.luminance[i] = select(usable, new_luminance, old_luminance);
    s.dn[i] = dn;
    clamped += usable ? 0u : 1u;
  }
  // average, then map to log intensity
  const float* light = s.usable = s.luminance;
  if (step.settings.averages()) {
    changed |=
        update_running_mean(step.arrays.running_mean, s.luminance, last, first, count, s.mean);
    light = s.mean;
  }
  if (clamped != 0 || step.settings.averages()) {
    for (size_t i = 0; i < count; i++) s.dn[i] = to_dn(map, light[i]);
  }
  for (size_t i = 0; i < count; i++) s.log_part[i] = log_part<KIND>(map, s.dn[i]);
  for (size_t i = 0; i < count; i++) {
    const float new_log = with_log_part<KIND>(map, s.dn[i], s.log_part[i]);
    const float old_log = last_log[i];
    s.log[i] = select(light[i] > -BLACK, new_log, old_log);
  }
  return clamped;
}

// The same for the kind of this sensor, which is chosen once a block.
EVS_ALWAYS_INLINE size_t log_intensity(const PixelStep& step, size_t first, size_t count,
                                       Scratch& s, bool safe, bool& changed) {
  switch (step.settings.log()) {
    case LogKind::LINLOG:
      return log_intensity<LogKind::LINLOG>(step, first, count, s, safe, changed);
    case LogKind::LOG_EPS:
      return log_intensity<LogKind::LOG_EPS>(step, first, count, s, safe, changed);
    default:
      return log_intensity<LogKind::LN>(step, first, count, s, safe, changed);
  }
}

// One pole. In: its input `x0` and `x1` at the start and the end of the tick; `step_pole`, one
// step. In/out: `state`, its output; `changed`, set if a state changes. Out: `from`, the output at
// the start of the tick. At its first light a pixel starts from its log intensity.
template <class StepPole>
EVS_ALWAYS_INLINE void filter(StepPole&& step_pole, const float* __restrict last_log,
                              const float* __restrict now_log, const float* __restrict x0,
                              const float* __restrict x1, float* __restrict state, size_t count,
                              float* __restrict from, bool& changed) {
  uint32_t difference = 0;
  for (size_t i = 0; i < count; i++) {
    const float log = now_log[i];
    const float before = last_log[i];
    const float y0 = state[i];
    const float y1 = step_pole(i, y0, x0[i], x1[i]);
    const bool begins = before != before;
    const float to = select(begins, log, y1);
    from[i] = select(begins, log, y0);
    difference |= std::bit_cast<uint32_t>(to) ^ std::bit_cast<uint32_t>(y0);
    state[i] = to;
  }
  if (!changed) changed = difference != 0;
}

// The input of the comparators at the start and the end of the tick.
struct Signal {
  const float* from;
  const float* to;
};

// The rate of a photoreceptor, in units of 1 / tick. In: its output and its input at the start of
// the tick.
EVS_ALWAYS_INLINE float photoreceptor_rate(const PixelStep& step, float dn, float y0, float x0) {
  const float z = step.lowpass_low + step.lowpass_slope * dn;
  return step.settings.steps_by_large_signal() ? large_signal_rate(z, y0, x0)
                                               : at_most(flush_to_zero(z, SLOWEST), LONGEST);
}

// The follower's lag behind a block of photoreceptors, and their rates and LowpassStep::a.
EVS_ALWAYS_INLINE void follower_lags(const PixelStep& step, size_t first, size_t count,
                                     Scratch& s) {
  const float* __restrict x0 = step.arrays.last_log + first;
  const float* __restrict p0 = s.from[0];
  const float* __restrict dn = s.dn;
  const LowpassStep follower = step.follower;
  const float z = step.follower_z;
  float* __restrict rate = s.a;
  float* __restrict share = s.b;
  float* __restrict lag = s.lag;
  const float low = step.lowpass_low;
  const float slope = step.lowpass_slope;
  uint32_t largest = 0;  // signal, of which it depends whether the rate is z
  if (step.settings.steps_by_large_signal()) {
    for (size_t i = 0; i < count; i++) {
      const uint32_t bits = std::bit_cast<uint32_t>(x0[i] - p0[i]) & 0x7fffffffu;
      largest = bits > largest ? bits : largest;
    }
  }
  uint32_t slowest = 0xffffffffu;
  auto rates = [&](auto&& rate_of) {
    for (size_t i = 0; i < count; i++) {
      const float k = apart_from(rate_of(i), z);
      const uint32_t bits = std::bit_cast<uint32_t>(k);
      slowest = bits < slowest ? bits : slowest;
      rate[i] = k;
    }
  };
  if (largest >= std::bit_cast<uint32_t>(SMALL_SIGNAL)) {
    rates([&](size_t i) { return large_signal_rate(low + slope * dn[i], p0[i], x0[i]); });
  } else {
    rates([&](size_t i) { return at_most(low + slope * dn[i], LONGEST); });
  }
  auto lags = [&](auto&& pole_of) {
    for (size_t i = 0; i < count; i++) {
      const LowpassStep pole = pole_of(rate[i]);
      share[i] = pole.a;
      lag[i] = follower_lag(rate[i], pole, z, follower);
    }
  };
  if (slowest < std::bit_cast<uint32_t>(VANISHED)) {
    lags([](float k) { return lowpass_step(k); });
  } else {
    lags([](float k) { return LowpassStep{1.0f, 1.0f - 1.0f / k}; });
  }
}

// The outputs of a block of large-signal photoreceptors at the end of the tick, into `s.a`. In:
// whether its light has changed.
EVS_ALWAYS_INLINE void step_large_signals(const PixelStep& step, size_t first, size_t count,
                                          Scratch& s, bool changed) {
  const float low = step.lowpass_low;
  const float slope = step.lowpass_slope;
  const float* __restrict y0 = step.arrays.filtered + first;
  const float* __restrict x0 = step.arrays.last_log + first;
  const float* __restrict x1 = s.log;
  const float* __restrict dn = s.dn;
  float* __restrict y1 = s.a;
  uint32_t moving = changed;
  if (!changed) {
    for (size_t i = 0; i < count; i++) {
      const uint32_t bits = std::bit_cast<uint32_t>(x1[i]);
      moving |= (bits ^ std::bit_cast<uint32_t>(x0[i])) | (bits ^ std::bit_cast<uint32_t>(y0[i]));
    }
  }
  if (moving == 0) {
    for (size_t i = 0; i < count; i++) y1[i] = flush_to_zero(y0[i], FADED);
    return;
  }
  // the bits of rates have their order; those of NaN come after them
  uint32_t slowest = 0xffffffffu;
  uint32_t fastest = 0;
  for (size_t i = 0; i < count; i++) {
    const uint32_t bits = std::bit_cast<uint32_t>(low + slope * dn[i]);
    slowest = bits < slowest ? bits : slowest;
    fastest = bits > fastest ? bits : fastest;
  }
  uint32_t apart = 1;  // signals, from their light
  if (slowest >= std::bit_cast<uint32_t>(IN_LIGHT) && fastest <= std::bit_cast<uint32_t>(LONGEST)) {
    apart = 0;
    for (size_t i = 0; i < count; i++) apart |= is_near_light(y0[i], x0[i], x1[i]) ? 0u : 1u;
  }
  if (apart == 0) {
    for (size_t i = 0; i < count; i++) {
      y1[i] = large_signal_in_light(low + slope * dn[i], y0[i], x0[i], x1[i]);
    }
  } else {
    for (size_t i = 0; i < count; i++) {
      y1[i] = large_signal(low + slope * dn[i], y0[i], x0[i], x1[i]);
    }
  }
}

// Limit the bandwidth of the log intensity.
EVS_ALWAYS_INLINE Signal limit_bandwidth(const PixelStep& step, size_t first, size_t count,
                                         Scratch& s, bool& changed) {
  const float* last_log = step.arrays.last_log + first;
  const bool euler = step.settings.steps_as_euler();
  Signal signal{last_log, s.log};
  // photoreceptor: a pole in proportion to light
  if (step.settings.lowpass()) {
    float* state = step.arrays.filtered + first;
    const float low = step.lowpass_low;
    const float slope = step.lowpass_slope;
    const float* __restrict dn = s.dn;
    const float* __restrict a = s.a;
    const float* __restrict b = s.b;
    auto exact_step = [=](size_t i, float y0, float x0, float x1) {
      return lowpass(LowpassStep{a[i], b[i]}, y0, x0, x1);
    };
    auto euler_step = [=](size_t i, float y0, float, float x1) {
      return lowpass_euler(low + slope * dn[i], y0, x1);
    };
    if (euler) {
      filter(euler_step, last_log, s.log, last_log, s.log, state, count, s.from[0], changed);
    } else if (step.settings.steps_by_large_signal()) {
      step_large_signals(step, first, count, s, changed);
      auto stepped = [=](size_t i, float, float, float) { return a[i]; };
      filter(stepped, last_log, s.log, last_log, s.log, state, count, s.from[0], changed);
    } else {
      // short loops, so that a core overlaps several iterations
      for (size_t i = 0; i < count; i++) s.a[i] = lowpass_a(low + slope * dn[i]);
      for (size_t i = 0; i < count; i++) s.b[i] = lowpass_b(low + slope * dn[i], s.a[i]);
      filter(exact_step, last_log, s.log, last_log, s.log, state, count, s.from[0], changed);
    }
    signal = {s.from[0], state};
  }
  // source follower: a fixed pole
  if (step.settings.follower > 0.0) {
    float* state = step.arrays.followed + first;
    const LowpassStep follower = step.follower;
    const float z = step.follower_z;
    auto euler_step = [=](size_t, float y0, float, float x1) { return lowpass_euler(z, y0, x1); };
    // the input is not overwritten by the output
    if (euler) {
      filter(euler_step, last_log, s.log, signal.from, signal.to, state, count, s.from[1], changed);
    } else if (step.bends()) {
      // the photoreceptor's output is no line
      follower_lags(step, first, count, s);
      const float* __restrict lag = s.lag;
      const float* __restrict x0 = last_log;
      const float* __restrict x1 = s.log;
      auto exact_step = [=](size_t i, float y0, float p0, float p1) {
        const float bend = (x1[i] - x0[i]) - (p1 - p0);
        return lowpass(follower, y0, p0, p1, bend * lag[i]);
      };
      filter(exact_step, last_log, s.log, signal.from, signal.to, state, count, s.from[1], changed);
    } else {
      auto exact_step = [=](size_t, float y0, float x0, float x1) {
        return lowpass(follower, y0, x0, x1);
      };
      filter(exact_step, last_log, s.log, signal.from, signal.to, state, count, s.from[1], changed);
    }
    signal = {s.from[1], state};
  }
  return signal;
}

// The signal of pixel i of a block inside the tick, against a reference that sinks by `drift`.
EVS_CALL_ON_DEVICE inline Response response_of(const PixelStep& step, size_t first, size_t i,
                                               const Scratch& s, Signal signal, double drift) {
  const double moved = static_cast<double>(signal.to[i]) - signal.from[i];
  Response response = Response::line(moved + drift);
  if (!step.curves || moved == 0.0) return response;
  const PixelArrays& arrays = step.arrays;
  const double x0 = arrays.last_log[first + i];
  const double span = static_cast<double>(s.log[i]) - x0;
  const bool follows = step.settings.follower > 0.0;
  double a = 0.0, b = 0.0;
  double input = x0;  // of the follower
  if (step.settings.lowpass()) {
    // its output falls behind a line with the slope of its input
    const float p0 = s.from[0][i];
    response.k =
        follows ? s.a[i] : photoreceptor_rate(step, s.dn[i], p0, arrays.last_log[first + i]);
    a = follows ? s.b[i] : lowpass_share(response.k);
    response.settling = response.k > 0.0f ? 1.0 / response.k : 0.0;
    const double bend = span - (static_cast<double>(arrays.filtered[first + i]) - p0);
    response.first = a > 0.0 ? -(bend / a) : 0.0;
    input = p0;
  }
  if (follows) {
    response.z = step.follower_z;
    b = step.follower.a;
    const double z = response.z;
    const double lasts = 1.0 / z;
    response.settling += lasts;
    response.second = (input - signal.from[i]) - span * lasts;
    if (step.settings.lowpass()) {
      const double k = response.k;
      const double share = response.first / (z - k);
      response.second -= share * k;
      response.first = share * z;
    }
  }
  // rounding of the filters is spread over the tick
  response.slope = response.end - (response.first * a + response.second * b);
  return straighten(response, step.tick.us);
}

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
      static_cast<double>(step.tick.begin_us - step.arrays.since_us[first / BLOCK_PIXELS]);
  if (skipped_us == 0.0) return;
  const float* light =
      (step.settings.averages() ? step.arrays.running_mean.mean : step.arrays.last_luminance) +
      first;
  double* reference = step.arrays.reference + first;
  for (size_t i = 0; i < count; i++) {
    reference[i] -= leak_rate(step, first + i, to_dn(step.settings.map, light[i])) * skipped_us;
  }
}

// The references at the start of the tick and by how much they sink in it, into the scratch.
EVS_ALWAYS_INLINE void reference_drift(const PixelStep& step, size_t first, size_t count,
                                       Signal signal, Scratch& s, bool& changed) {
  const double* __restrict reference = step.arrays.reference + first;
  const double us = step.tick.us;
  // leak
  if (step.pattern.leak == nullptr) {
    for (size_t i = 0; i < count; i++) {
      s.reference[i] = reference[i];
      s.drift[i] = 0.0;
    }
  } else {
    for (size_t i = 0; i < count; i++) {
      s.reference[i] = reference[i];
      s.drift[i] = leak_rate(step, first + i, s.dn[i]) * us;
    }
  }
  if (step.settings.highpass > 0.0) {
    // high pass: the reference follows the signal, so that their distance is high-passed
    const double a = step.highpass.a;
    const double b = step.highpass.b;
    uint64_t difference = 0;
    for (size_t i = 0; i < count; i++) {
      const double from = signal.from[i];
      const double to = signal.to[i];
      const double old = s.drift[i];
      const double rise = on_grid(a * (from - s.reference[i]) + b * (to - from));
      const double drift = rise == rise ? old - rise : old;
      difference |= std::bit_cast<uint64_t>(drift) ^ std::bit_cast<uint64_t>(old);
      s.drift[i] = drift;
    }
    // a leaking reference keeps changing: it may come within reach of the high pass
    changed |= difference != 0 || step.pattern.leak != nullptr;
  }
}

}  // namespace evs
