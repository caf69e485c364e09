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

#include "base/reproducible_math.h"

namespace evs {

struct LowpassStep {
  float a;
  float b;
};

inline constexpr float FADED = 0x1p-64f;  // log units
inline constexpr float SETTLED = 80.0f;   // e^-80 vanishes beside 1
inline constexpr float LONGEST = 0x1p100f;
inline constexpr float SERIES_BELOW = 0x1.8p-5f;
inline constexpr float VANISHED = 18.0f;  // 1 - e^-z is 1 from here on, in floats

// The smaller of a number, without its sign, and a limit; a NaN counts as the limit. It is taken of
// the bits, which have the order of such floats, because compilers vectorise it.
EVS_ALWAYS_INLINE float at_most(float value, float limit) {
  const uint32_t bits = std::bit_cast<uint32_t>(value) & 0x7fffffffu;
  const uint32_t most = std::bit_cast<uint32_t>(limit);
  return std::bit_cast<float>(bits < most ? bits : most);
}

// a of z >= 0; z may be infinite, and a NaN counts as infinite. Relative error below 1e-6.
EVS_ALWAYS_INLINE float lowpass_a(float any_z) { return one_minus_exp(at_most(any_z, SETTLED)); }

// The same of one pixel, sooner where it is 1.
EVS_ALWAYS_INLINE float lowpass_share(float z) { return z >= VANISHED ? 1.0f : lowpass_a(z); }

// b of z and its a. Relative error below 4e-6.
EVS_ALWAYS_INLINE float lowpass_b(float z, float a) {
  // close to zero the difference cancels, so b comes from its series
  const float series = (0.5f - (0x1.555556p-3f - 0x1.555556p-5f * z) * z) * z;
  const float closed_form = 1.0f - a / (z < LONGEST ? z : LONGEST);
  return select(z < SERIES_BELOW, series, closed_form);
}

EVS_ALWAYS_INLINE LowpassStep lowpass_step(float z) {
  const float a = lowpass_a(z);
  return {a, lowpass_b(z, a)};
}

EVS_ALWAYS_INLINE float lowpass(LowpassStep step, float y0, float x0, float x1) {
  return flush_to_zero(y0 + (step.a * (x0 - y0) + step.b * (x1 - x0)), FADED);
}

// The same behind a photoreceptor, corrected by how much its bent output falls short of a line.
EVS_ALWAYS_INLINE float lowpass(LowpassStep step, float y0, float x0, float x1, float short_of) {
  return flush_to_zero(y0 + ((step.a * (x0 - y0) + step.b * (x1 - x0)) - short_of), FADED);
}

// Two poles in series: the photoreceptor's output p goes from p0 to p1 while its input x goes from
// x0 to x1, and is no line: with the rate k, in units of 1 / tick,
//   p(u) = p0 + (p1 - p0) u + e (u - (1 - e^-ku) / (1 - e^-k)),  e = (x1 - x0) - (p1 - p0),
// which is exact for a pole. The follower's step for the line from p0 to p1 is corrected by -e
// times this: k (b2 a - a2 b) / (a (z2 - k)), where a, b are those of k and a2, b2 those of z2.
inline constexpr float STRAIGHT = 0x1p-20f;  // a pole below this, as z, bends nothing

// k as the formula takes it: it has a removable singularity at z2.
EVS_ALWAYS_INLINE float apart_from(float k, float z2) {
  const float apart = k - z2;
  const float rate = (apart < 0.0f ? -apart : apart) < z2 * 0x1p-8f ? z2 * 0x1.01p+0f : k;
  return rate > STRAIGHT ? rate : STRAIGHT;
}

EVS_ALWAYS_INLINE float follower_lag(float k, LowpassStep first, float z2, LowpassStep second) {
  return k * (second.b * first.a - second.a * first.b) / (first.a * (z2 - k));
}

// v2e's Euler step, which sees the new light for the whole tick: y1 = y0 + min(1, z) (x1 - y0).
EVS_ALWAYS_INLINE float lowpass_euler(float z, float y0, float x1) {
  const float share = z < 1.0f ? z : 1.0f;
  return flush_to_zero(y0 + share * (x1 - y0), FADED);
}

// The large-signal photoreceptor. Its feedback transistor is exponential, so that the current into
// its node is I - e^y, y in units of the thermal voltage: y' = w (1 - e^(y - x)) with x = ln I and
// w in proportion to I. For small signals it is the pole above. A step into bright light is fast,
// one into the dark slow, and never faster than w.
//
// q = e^(x - y) has the linear equation q' = (x' - w) q + w. With z = w dt, s = x1 - x0 and
// m = z - s, a tick of a constant w and a straight x has the solution
//
//   e^(y0 - y1) = 1 + rho,   rho = zg - a + zg (e^v - 1),
//   a = 1 - e^-z,   zg = z (1 - e^-|m|) / |m|,   v = max(s - z, 0) - (x1 - y0).
//
// In this form a pixel that has settled (s = 0, x1 = y0) has rho = 0 exactly, small steps keep
// their relative precision, and no exponential of a large positive number occurs.
inline constexpr float SLOWEST = 0x1p-90f;  // a z below this moves nothing

// The rate is z of a signal that is closer to its light.
inline constexpr float SMALL_SIGNAL = 0x1p-12f;  // log units

// The rate at which y approaches x at first: y' = k (x - y), k = z (1 - e^-d) / d with d = x - y.
EVS_ALWAYS_INLINE float large_signal_rate(float any_z, float y0, float x0) {
  const float z = at_most(flush_to_zero(any_z, SLOWEST), LONGEST);
  const float d = x0 - y0;
  const float size = at_most(d, SETTLED);
  const bool near = size < SMALL_SIGNAL;
  const ExpParts parts = exp_parts(size);
  const float into_light = one_minus_exp(parts) / select(near, 1.0f, size);
  const float share = select(d < 0.0f, into_light / exp_minus(parts), into_light);
  return at_most(select(near, z, z * share), LONGEST);
}

EVS_ALWAYS_INLINE float large_signal(float any_z, float y0, float x0, float x1) {
  const float z = at_most(flush_to_zero(any_z, SLOWEST), LONGEST);
  const float s = x1 - x0;
  const float m = z - s;
  const float v = (m < 0.0f ? -m : 0.0f) - (x1 - y0);
  // a factor is taken out where e^-z and e^v both vanish, in a large step up, and where e^v
  // overflows, in a large step down
  const float least = z < -v ? z : -v;
  const float shift = least > 64.0f ? least - 64.0f : 0.0f;
  const float over = v > SETTLED ? v - SETTLED : 0.0f;

  const float size = at_most(m, LONGEST);
  const bool is_short = size < 0x1p-24f;
  const float share = select(is_short, 1.0f, lowpass_a(size) / select(is_short, 1.0f, size));
  const ExpParts by_z = exp_parts(at_most(z - shift, SETTLED));
  const ExpParts by_v = exp_parts(at_most(v + shift, SETTLED));
  const float a = one_minus_exp(by_z);
  const float zg = select(s == 0.0f, a, z * share);
  const bool falls = v > 0.0f;
  const float e_v = exp_minus(by_v);
  const float grown = 1.0f / e_v;
  const float rho =
      (zg - a) + zg * select(falls, one_minus_exp(by_v) * grown, -one_minus_exp(by_v));

  // ln(1 + rho); of a large step up by its two positive terms, where nothing cancels
  const float sum = 1.0f + rho;
  const bool rises_far = rho < -0.5f;
  const float u = select(rises_far, exp_minus(by_z) + zg * select(falls, grown, e_v), sum);
  const float lost = select(rises_far, 0.0f, rho - (sum - 1.0f)) / u;
  const float y1 = (y0 - (ln(u) + lost)) + (shift - over);
  return flush_to_zero(select(z > 0.0f, y1, y0), FADED);
}

// The same for a pixel in light, z from IN_LIGHT to LONGEST, and near it: e^-z and e^-|m| vanish
// beside all that they are added to.
inline constexpr float IN_LIGHT = 40.0f;

EVS_ALWAYS_INLINE bool is_near_light(float y0, float x0, float x1) {
  constexpr float MOST = 16.0f;  // log units, by which its light differs
  return (at_most(x1 - x0, SETTLED) < MOST) & (at_most(x1 - y0, SETTLED) < MOST);
}

EVS_ALWAYS_INLINE float large_signal_in_light(float z, float y0, float x0, float x1) {
  const float s = x1 - x0;
  const float v = 0.0f - (x1 - y0);
  const float zg = select(s == 0.0f, 1.0f, z * (1.0f / (z - s)));
  const ExpParts by_v = exp_parts(at_most(v, SETTLED));
  const bool falls = v > 0.0f;
  const float e_v = exp_minus(by_v);
  const float grown = 1.0f / e_v;
  const float rho =
      (zg - 1.0f) + zg * select(falls, one_minus_exp(by_v) * grown, -one_minus_exp(by_v));
  const float sum = 1.0f + rho;
  const bool rises_far = rho < -0.5f;
  const float u = select(rises_far, zg * select(falls, grown, e_v), sum);
  const float lost = select(rises_far, 0.0f, rho - (sum - 1.0f)) / u;
  return flush_to_zero(y0 - (ln(u) + lost), FADED);
}

}  // namespace evs
