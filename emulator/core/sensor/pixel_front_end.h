// What happens to a block of pixels before the comparators: light, running mean, log, filters,
// leak.
//
// Each term is a loop over the 64 pixels of a block. Loops load all they choose from before they
// choose, and what they store cannot be what they load: nothing keeps the compiler from SIMD.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "comparator.h"
#include "pixel.h"

namespace evs {

// What the stages of one block hand to each other.
struct Scratch {
  alignas(64) float light[kBlock];  // luminance, the last good one where it is none
  alignas(64) float mean[kBlock];   // its running mean
  alignas(64) float dn[kBlock];
  alignas(64) float part[kBlock];
  alignas(64) float a[kBlock];  // LowpassStep, of each pixel's light
  alignas(64) float b[kBlock];
  alignas(64) float log[kBlock];         // log light at the end of the tick
  alignas(64) float from[2][kBlock];     // after each filter, at the start of the tick
  alignas(64) double reference[kBlock];  // at the start of the tick
  alignas(64) double drift[kBlock];      // by how much it sinks
};

// How a block's light differs from its last.
struct BlockLight {
  bool moved;  // a pixel's changed, or is none
  bool plain;  // all of it is below `plain`, and not negative
};

EVS_ALWAYS_INLINE BlockLight look(const float* luminance, const float* last, float plain,
                                  size_t count) {
  uint32_t changed = 0;
  uint32_t most = 0;
  for (size_t i = 0; i < count; i++) {
    const uint32_t bits = std::bit_cast<uint32_t>(luminance[i]);
    most = bits > most ? bits : most;
    changed |= bits ^ std::bit_cast<uint32_t>(last[i]);
  }
  // the bits of light have its order, and those of what is negative or NaN come after them
  return {changed != 0 || most >= 0x7f800000u, most < std::bit_cast<uint32_t>(plain)};
}

// Luminance to log light. Out: how many pixels had no usable light; they keep their last.
template <LogKind kind>
EVS_ALWAYS_INLINE size_t to_log_light(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                      bool plain, bool& moved) {
  const LogMap map = step.settings.map;
  const float* __restrict luminance = step.tick.luminance + first;
  const float* __restrict last = step.arrays.last_luminance + first;
  const float* __restrict last_log = step.arrays.last_log + first;
  const float largest = step.settings.average ? kLargestMean : kLargest;
  if (plain && !step.settings.average) {
    for (size_t i = 0; i < count; i++) {
      s.light[i] = luminance[i];
      s.dn[i] = to_dn(map, luminance[i]);
    }
    for (size_t i = 0; i < count; i++) s.part[i] = log_part<kind>(map, s.dn[i]);
    for (size_t i = 0; i < count; i++) s.log[i] = with_log_part<kind>(map, s.dn[i], s.part[i]);
    return 0;
  }
  uint32_t clamped = 0;
  for (size_t i = 0; i < count; i++) {
    const float new_light = luminance[i];
    const float old_light = last[i];
    const float dn = to_dn(map, new_light);
    const bool usable = is_light(new_light, dn) & (new_light <= largest);
    s.light[i] = choose(usable, new_light, old_light);
    s.dn[i] = dn;
    clamped += usable ? 0u : 1u;
  }
  const float* light = s.light;
  if (step.settings.average) {
    moved |= average(step.arrays.average, s.light, last, first, count, s.mean);
    light = s.mean;
  }
  if (clamped != 0 || step.settings.average) {
    for (size_t i = 0; i < count; i++) s.dn[i] = to_dn(map, light[i]);
  }
  for (size_t i = 0; i < count; i++) s.part[i] = log_part<kind>(map, s.dn[i]);
  for (size_t i = 0; i < count; i++) {
    const float new_log = with_log_part<kind>(map, s.dn[i], s.part[i]);
    const float old_log = last_log[i];
    s.log[i] = choose(light[i] > -kBlack, new_log, old_log);
  }
  return clamped;
}

// One pole of the signal: `x0` and `x1` before and after the tick, `state` its own value, In/out.
// Out: from, what it was; a pixel without light before starts with what it sees. `moved` gets true
// if a state changes.
template <class Step>
EVS_ALWAYS_INLINE void filter(Step&& next, const float* __restrict last_log,
                              const float* __restrict now_log, const float* __restrict x0,
                              const float* __restrict x1, float* __restrict state, size_t count,
                              float* __restrict from, bool& moved) {
  uint32_t changed = 0;
  for (size_t i = 0; i < count; i++) {
    const float log = now_log[i];
    const float before = last_log[i];
    const float y0 = state[i];
    const float y1 = next(i, y0, x0[i], x1[i]);
    const bool begins = before != before;
    const float to = choose(begins, log, y1);
    from[i] = choose(begins, log, y0);
    changed |= std::bit_cast<uint32_t>(to) ^ std::bit_cast<uint32_t>(y0);
    state[i] = to;
  }
  if (!moved) moved = changed != 0;
}

// The signal that the comparators see, at the start and the end of the tick.
struct Signal {
  const float* from;
  const float* to;
};

EVS_ALWAYS_INLINE Signal to_signal(const PixelStep& step, size_t first, size_t count, Scratch& s,
                                   bool& moved) {
  const float* last_log = step.arrays.last_log + first;
  const bool euler = step.settings.euler;
  Signal signal{last_log, s.log};
  if (step.settings.lowpass()) {
    float* state = step.arrays.filtered + first;
    const float low = step.lowpass_low;
    const float slope = step.lowpass_slope;
    const float* __restrict dn = s.dn;
    const float* __restrict a = s.a;
    const float* __restrict b = s.b;
    auto exact = [=](size_t i, float y0, float x0, float x1) {
      return lowpass(LowpassStep{a[i], b[i]}, y0, x0, x1);
    };
    auto as_v2e = [=](size_t i, float y0, float, float x1) {
      return lowpass_euler(low + slope * dn[i], y0, x1);
    };
    if (euler) {
      filter(as_v2e, last_log, s.log, last_log, s.log, state, count, s.from[0], moved);
    } else {
      // short loops: a core looks ahead over several of their turns at once
      for (size_t i = 0; i < count; i++) s.a[i] = lowpass_a(low + slope * dn[i]);
      for (size_t i = 0; i < count; i++) s.b[i] = lowpass_b(low + slope * dn[i], s.a[i]);
      filter(exact, last_log, s.log, last_log, s.log, state, count, s.from[0], moved);
    }
    signal = {s.from[0], state};
  }
  if (step.settings.follower > 0.0) {
    float* state = step.arrays.followed + first;
    const LowpassStep follower = step.follower;
    const float z = step.follower_z;
    auto exact = [=](size_t, float y0, float x0, float x1) {
      return lowpass(follower, y0, x0, x1);
    };
    auto as_v2e = [=](size_t, float y0, float, float x1) { return lowpass_euler(z, y0, x1); };
    // what comes in is not overwritten by what goes out
    if (euler) {
      filter(as_v2e, last_log, s.log, signal.from, signal.to, state, count, s.from[1], moved);
    } else {
      filter(exact, last_log, s.log, signal.from, signal.to, state, count, s.from[1], moved);
    }
    signal = {s.from[1], state};
  }
  return signal;
}

// Log units per us by which the reference of a pixel sinks at this light; a multiple of 2^-43.
// Light brings at most one event a us: a pixel that looks into the sun must not fill the memory.
EVS_ALWAYS_INLINE double leak_of(const PixelStep& step, size_t pixel, float dn) {
  const double dark = step.pattern.leak[pixel];
  if (step.pattern.parasitic == nullptr) return dark;
  const double most = step.pattern.theta_on[pixel];
  const double more = step.pattern.parasitic[pixel] * (step.settings.parasitic_slope * dn);
  return dark + on_grid(more < most ? more : most);
}

// What leaked in the ticks in which the block was left out, at the light of then.
EVS_ALWAYS_INLINE void catch_up(const PixelStep& step, size_t first, size_t count) {
  if (step.pattern.leak == nullptr) return;
  const double owed =
      static_cast<double>(step.tick.begin_us - step.arrays.since_us[first / kBlock]);
  if (owed == 0.0) return;
  const float* light =
      (step.settings.average ? step.arrays.average.mean : step.arrays.last_luminance) + first;
  double* reference = step.arrays.reference + first;
  for (size_t i = 0; i < count; i++) {
    reference[i] -= leak_of(step, first + i, to_dn(step.settings.map, light[i])) * owed;
  }
}

// The reference at the start of the tick, and how far it sinks in it, into the scratch.
EVS_ALWAYS_INLINE void to_drift(const PixelStep& step, size_t first, size_t count, Signal signal,
                                Scratch& s, bool& moved) {
  const double* __restrict reference = step.arrays.reference + first;
  const double us = step.tick.us;
  if (step.pattern.leak == nullptr) {
    for (size_t i = 0; i < count; i++) {
      s.reference[i] = reference[i];
      s.drift[i] = 0.0;
    }
  } else {
    for (size_t i = 0; i < count; i++) {
      s.reference[i] = reference[i];
      s.drift[i] = leak_of(step, first + i, s.dn[i]) * us;
    }
  }
  if (step.settings.highpass > 0.0) {
    // the reference follows the signal: what is left of their distance is high-passed
    const double a = step.highpass.a;
    const double b = step.highpass.b;
    uint64_t changed = 0;
    for (size_t i = 0; i < count; i++) {
      const double from = signal.from[i];
      const double to = signal.to[i];
      const double old = s.drift[i];
      const double rise = on_grid(a * (from - s.reference[i]) + b * (to - from));
      const double drift = rise == rise ? old - rise : old;
      changed |= std::bit_cast<uint64_t>(drift) ^ std::bit_cast<uint64_t>(old);
      s.drift[i] = drift;
    }
    // a reference that leaks does not stand still: it may come within reach of the high pass
    moved |= changed != 0 || step.pattern.leak != nullptr;
  }
}

}  // namespace evs
