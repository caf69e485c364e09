// Elementary functions on lanes, accurate to about 1e-6, with the same bytes in every build.
#pragma once

#include "base/simd.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// log2 of a positive, finite number: the exponent plus the series of atanh on the mantissa
EVS_INLINE Float log2(Float a) {
  Int i = as_int(a);
  Int exponent = shift_right<23>(i - splat(0x3f3504f3));  // mantissa in [sqrt(1/2), sqrt(2))
  Float m = as_float(i - exponent * splat(1 << 23));
  Float s = (m - 1.0f) / (m + 1.0f), q = s * s;
  Float series = ((q * (1.0f / 7.0f) + 0.2f) * q + 1.0f / 3.0f) * q + 1.0f;
  return to_float(exponent) + s * series * 2.88539008f;
}

// 2^a for -126 < a < 127; less gives 0
EVS_INLINE Float exp2(Float a) {
  Float clipped = max(a, splat(-126.0f));
  Float whole = floor(clipped + 0.5f), f = (clipped - whole) * 0.693147181f;
  Float p = ((((f * (1.0f / 720) + 1.0f / 120) * f + 1.0f / 24) * f + 1.0f / 6) * f + 0.5f) * f;
  Float power = (p + 1.0f) * f + 1.0f;
  Int scale = (truncate(whole) + splat(127)) * splat(1 << 23);
  return select(a < -126.0f, splat(0.0f), power * as_float(scale));
}

constexpr float MAX_INTEGER_EXPONENT = 1024;  // largest exponent that is raised by squaring

// x^e for x in [0, 1] and e = 0, 1, ... MAX_INTEGER_EXPONENT, by squaring
EVS_INLINE Float pow(Float x, int e) {
  Float out = splat(1.0f);
  for (;; x = x * x) {
    if (e & 1) out = out * x;
    e >>= 1;
    if (!e) return out;
  }
}

// x^e for x in [0, 1] and any e >= 0
EVS_INLINE Float pow_by_log2(Float x, Float e) {
  return select(x > 1e-30f, exp2(log2(max(x, splat(1e-30f))) * e), splat(0.0f));
}

// x^e for x in [0, 1] and e >= 0, integer or not
EVS_INLINE Float pow(Float x, float e) {
  int number = e <= MAX_INTEGER_EXPONENT ? static_cast<int>(e) : -1;
  if (static_cast<float>(number) == e) return pow(x, number);
  return pow_by_log2(x, splat(e));
}

// x^e on `lanes`, with an exponent for each; other lanes hold anything. The result of a lane
// depends on that lane alone.
inline Float pow(Float x, Float e, Mask lanes) {
  Int number = truncate(min(e, splat(MAX_INTEGER_EXPONENT)));
  Mask whole = lanes & (to_float(number) <= e) & (e <= to_float(number));
  Float out = splat(0.0f);
  if (any(whole)) {
    int first = lane(number, first_lane(to_bits(whole)));
    Mask same = whole & (number == splat(first));
    out = pow(x, first);
    for (Mask rest = whole & ~same; any(rest); rest = rest & ~same) {
      first = lane(number, first_lane(to_bits(rest)));
      same = rest & (number == splat(first));
      out = select(same, pow(x, first), out);
    }
    if (!any(lanes & ~whole)) return out;
  }
  return select(whole, out, pow_by_log2(x, e));
}

// angle of (x, y) in turns, 0 ... 1; Abramowitz & Stegun 4.4.49, error 1e-5 rad
EVS_INLINE Float atan2_turns(Float y, Float x) {
  Float ax = abs(x), ay = abs(y);
  Mask steep = ay > ax;
  Float ratio = min(ax, ay) / max(max(ax, ay), splat(1e-30f)), q = ratio * ratio;
  Float angle =
      ((((q * 0.0208351f - 0.0851330f) * q + 0.1801410f) * q - 0.3302995f) * q + 0.9998660f) *
      ratio * 0.159154943f;
  angle = select(steep, 0.25f - angle, angle);
  angle = select(x < 0.0f, 0.5f - angle, angle);
  return select(y < 0.0f, 1.0f - angle, angle);
}

// cosine and sine of an angle in turns, 0 <= a <= 1; error 1e-6
EVS_INLINE void cos_sin_turns(Float a, Float& cosine, Float& sine) {
  // quadrants around 0, 1/4, 1/2, 3/4: the series on |angle| <= pi/4
  Float quadrant = floor(a * 4.0f + 0.5f);
  Float x = (a - quadrant * 0.25f) * 6.28318531f, q = x * x;
  Float s = ((q * (-1.0f / 5040) + 1.0f / 120) * q - 1.0f / 6) * q * x + x;
  Float c = (((q * (1.0f / 40320) - 1.0f / 720) * q + 1.0f / 24) * q - 0.5f) * q + 1.0f;
  Int k = truncate(quadrant);
  Mask odd = (k & splat(1)) == splat(1);
  Float first = select(odd, s, c), second = select(odd, c, s);
  // k 0: (c, s)  1: (-s, c)  2: (-c, -s)  3: (s, -c)
  Mask lower = (k & splat(2)) == splat(2), left = ((k + splat(1)) & splat(2)) == splat(2);
  cosine = select(left, -first, first);
  sine = select(lower, -second, second);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
