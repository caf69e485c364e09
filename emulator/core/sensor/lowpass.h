// One pole: y' = w (x - y), stepped exactly for a signal x that is a line inside the tick.
//
// With z = w dt the step is y1 = y0 + a (x0 - y0) + b (x1 - x0), where a = 1 - e^-z is how far y
// comes towards where x was, and b = 1 - a / z how much of the line y follows. Any z >= 0 is
// stable. y is 0 where it is closer to 0 than 2^-64: it would fade into denormals in black light,
// and what they do depends on the thread that flushes them.
#pragma once

#include <bit>
#include <cstdint>

#include "vmath.h"

namespace evs {

struct LowpassStep {
  float a;
  float b;
};

inline constexpr float kFaded = 0x1p-64f;  // log units
inline constexpr float kSettled = 80.0f;   // e^-80 is nothing beside 1
inline constexpr float kForEver = 0x1p100f;
inline constexpr float kNear = 0x1.8p-5f;

// Of z >= 0, also infinite, and a NaN counts as that. Relative error below 1e-6. The bits of such
// numbers have their order: compilers know a minimum of integers, and cut one of floats in two.
EVS_ALWAYS_INLINE float lowpass_a(float any_z) {
  constexpr uint32_t kMost = std::bit_cast<uint32_t>(kSettled);
  const uint32_t bits = std::bit_cast<uint32_t>(any_z) & 0x7fffffffu;
  return one_minus_exp(std::bit_cast<float>(bits < kMost ? bits : kMost));
}

// Of the same z and its a. Relative error below 4e-6.
EVS_ALWAYS_INLINE float lowpass_b(float z, float a) {
  // close to zero the difference cancels: there b by its series
  const float near_b = (0.5f - (0x1.555556p-3f - 0x1.555556p-5f * z) * z) * z;
  const float far_b = 1.0f - a / (z < kForEver ? z : kForEver);
  return choose(z < kNear, near_b, far_b);
}

EVS_ALWAYS_INLINE LowpassStep lowpass_step(float z) {
  const float a = lowpass_a(z);
  return {a, lowpass_b(z, a)};
}

EVS_ALWAYS_INLINE float lowpass(LowpassStep step, float y0, float x0, float x1) {
  return flush(y0 + (step.a * (x0 - y0) + step.b * (x1 - x0)), kFaded);
}

// v2e's step: the whole tick sees the new light, y1 = y0 + min(1, z) (x1 - y0).
EVS_ALWAYS_INLINE float lowpass_euler(float z, float y0, float x1) {
  const float share = z < 1.0f ? z : 1.0f;
  return flush(y0 + share * (x1 - y0), kFaded);
}

}  // namespace evs
