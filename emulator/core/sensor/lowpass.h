// A one-pole low pass, y' = w (x - y), stepped exactly for a signal x that is linear inside the
// tick.
//
// With z = w dt the step is y1 = y0 + a (x0 - y0) + b (x1 - x0): a = 1 - e^-z is how far y moves
// towards x0, and b = 1 - a / z is the share of the slope that y follows. Any z >= 0 is stable. A y
// closer to 0 than 2^-64 becomes 0, since it would decay into denormals in black light, whose
// effect depends on whether the thread flushes them.
#pragma once

#include <bit>
#include <cstdint>

#include "reproducible_math.h"

namespace evs {

struct LowpassStep {
  float a;
  float b;
};

inline constexpr float kFaded = 0x1p-64f;  // log units
inline constexpr float kSettled = 80.0f;   // e^-80 vanishes beside 1
inline constexpr float kLongest = 0x1p100f;
inline constexpr float kSeriesBelow = 0x1.8p-5f;

// a of z >= 0; z may be infinite, and a NaN counts as infinite. Relative error below 1e-6. The
// minimum is taken of the bits, which have the order of such floats, because compilers vectorise
// it.
EVS_ALWAYS_INLINE float lowpass_a(float any_z) {
  constexpr uint32_t kLimit = std::bit_cast<uint32_t>(kSettled);
  const uint32_t bits = std::bit_cast<uint32_t>(any_z) & 0x7fffffffu;
  return one_minus_exp(std::bit_cast<float>(bits < kLimit ? bits : kLimit));
}

// b of z and its a. Relative error below 4e-6.
EVS_ALWAYS_INLINE float lowpass_b(float z, float a) {
  // close to zero the difference cancels, so b comes from its series
  const float series = (0.5f - (0x1.555556p-3f - 0x1.555556p-5f * z) * z) * z;
  const float closed_form = 1.0f - a / (z < kLongest ? z : kLongest);
  return select(z < kSeriesBelow, series, closed_form);
}

EVS_ALWAYS_INLINE LowpassStep lowpass_step(float z) {
  const float a = lowpass_a(z);
  return {a, lowpass_b(z, a)};
}

EVS_ALWAYS_INLINE float lowpass(LowpassStep step, float y0, float x0, float x1) {
  return flush_to_zero(y0 + (step.a * (x0 - y0) + step.b * (x1 - x0)), kFaded);
}

// v2e's Euler step, which sees the new light for the whole tick: y1 = y0 + min(1, z) (x1 - y0).
EVS_ALWAYS_INLINE float lowpass_euler(float z, float y0, float x1) {
  const float share = z < 1.0f ? z : 1.0f;
  return flush_to_zero(y0 + share * (x1 - y0), kFaded);
}

}  // namespace evs
