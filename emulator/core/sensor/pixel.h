// The plain pixel: an event at every crossing of reference + theta_on or reference - theta_off.
//
// Contract. Log light moves linearly from its last value to the new one inside a tick. A level is
// reached when log light >= it (ON) or <= it (OFF): the closed side is the far one. Every event
// moves the reference by exactly one threshold, so that afterwards
//     reference - theta_off < log light < reference + theta_on,
// and no contrast is lost. The reference is a float64 that is always a multiple of 2^-32, and so is
// every float32 threshold from 2^-8 on: adding and subtracting thresholds is exact for references
// below 2^20, and a day of events drifts by nothing. Only the division in a stamp rounds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "logmap.h"

namespace evs {

// The n pixels of a frame, row by row.
struct PixelArrays {
  const float* luminance;  // In
  const float* theta_on;   // In, at least 2^-8
  const float* theta_off;  // In, at least 2^-8
  double* reference;       // In/out; NaN: this pixel has seen no light yet
  float* last_log;         // In/out
  float* last_luminance;   // In/out: the last luminance that was one
};

// An event before it is sorted: its pixel, and (stamp - t_begin) * 2 + polarity.
struct Crossing {
  uint32_t pixel;
  uint32_t when;
};

// Round to a multiple of 2^-32, ties to even; exact for |value| < 2^19.
EVS_ALWAYS_INLINE double on_grid(double value) { return (value + 0x1.8p20) - 0x1.8p20; }

// Microseconds after the start of a tick at which a line that moves `span` in `tick` us has moved
// `part`: rounded up, in [1, tick]. A NaN gives 1.
inline uint32_t crossing_time(double part, double span, double tick) {
  const double exact = part * tick / span;
  if (!(exact > 1.0)) return 1;
  if (exact >= tick) return static_cast<uint32_t>(tick);
  const uint32_t whole = static_cast<uint32_t>(exact);
  return whole + (static_cast<double>(whole) < exact);
}

// All crossings of pixel i on its way to the log light `now`, in order.
inline void cross(const PixelArrays& pixels, size_t i, float now, double tick,
                  std::vector<Crossing>& out) {
  double reference = pixels.reference[i];
  if (reference != reference) {  // the first light only sets the reference
    pixels.reference[i] = on_grid(now);
    return;
  }
  const double last = pixels.last_log[i];
  const double span = now - last;
  const double on = pixels.theta_on[i];
  const double off = pixels.theta_off[i];
  const uint32_t pixel = static_cast<uint32_t>(i);
  for (double level = reference + on; level <= now; level += on) {
    out.push_back({pixel, crossing_time(level - last, span, tick) * 2 + 1});
    reference = level;
  }
  for (double level = reference - off; level >= now; level -= off) {
    out.push_back({pixel, crossing_time(level - last, span, tick) * 2});
    reference = level;
  }
  pixels.reference[i] = reference;
}

inline constexpr size_t kBlock = 64;

// Pixels [first, first + count), count <= kBlock. Out: how many of them had no usable light.
// Those keep their last value. A block in which nothing changed costs one comparison per pixel.
template <LogKind kind>
EVS_ALWAYS_INLINE size_t step_block(const LogMap& map, const PixelArrays& pixels, size_t first,
                                    size_t count, double tick, std::vector<Crossing>& out) {
  const float* luminance = pixels.luminance + first;
  float* last_luminance = pixels.last_luminance + first;
  float* last_log = pixels.last_log + first;
  const float* theta_on = pixels.theta_on + first;
  const float* theta_off = pixels.theta_off + first;
  const double* reference = pixels.reference + first;

  // the same bits as last tick, and none of them negative, Inf or NaN: nothing to do
  uint32_t changed = 0;
  for (size_t i = 0; i < count; i++) {
    const uint32_t bits = std::bit_cast<uint32_t>(luminance[i]);
    const uint32_t unusable = bits >= 0x7f800000u ? 1u : 0u;
    changed |= (bits ^ std::bit_cast<uint32_t>(last_luminance[i])) | unusable;
  }
  if (changed == 0) return 0;

  // log light; each loop stores what the next one chooses from, so that no branch keeps the
  // compiler from SIMD
  alignas(64) float dn[kBlock];
  alignas(64) float logarithm[kBlock];
  alignas(64) float now[kBlock];
  alignas(64) float light[kBlock];
  for (size_t i = 0; i < count; i++) dn[i] = to_dn(map, luminance[i]);
  for (size_t i = 0; i < count; i++) logarithm[i] = log_part<kind>(map, dn[i]);
  uint32_t clamped = 0;
  for (size_t i = 0; i < count; i++) {
    const float new_light = luminance[i];
    const float old_light = last_luminance[i];
    const float old_log = last_log[i];
    const float new_log = with_log_part<kind>(map, dn[i], logarithm[i]);
    const bool usable = is_light(new_light, dn[i]);
    now[i] = usable ? new_log : old_log;
    light[i] = usable ? new_light : old_light;
    clamped += usable ? 0u : 1u;
  }

  // who has reached a level, or has no reference yet (a NaN is not quiet)
  alignas(64) int64_t loud[kBlock];
  int64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double value = now[i];
    const bool quiet = (value < reference[i] + static_cast<double>(theta_on[i])) &
                       (value > reference[i] - static_cast<double>(theta_off[i]));
    loud[i] = quiet ? 0 : 1;
    any |= loud[i];
  }
  if (any != 0) {
    for (size_t i = 0; i < count; i++) {
      if (loud[i] != 0) cross(pixels, first + i, now[i], tick, out);
    }
  }
  for (size_t i = 0; i < count; i++) last_log[i] = now[i];
  for (size_t i = 0; i < count; i++) last_luminance[i] = light[i];
  return clamped;
}

// Pixels [first, last) in order. Crossings are appended to `out`.
template <LogKind kind>
EVS_ALWAYS_INLINE size_t step_pixels(const LogMap& map, const PixelArrays& pixels, size_t first,
                                     size_t last, double tick, std::vector<Crossing>& out) {
  size_t clamped = 0;
  for (; first + kBlock <= last; first += kBlock) {
    clamped += step_block<kind>(map, pixels, first, kBlock, tick, out);
  }
  if (first < last) clamped += step_block<kind>(map, pixels, first, last - first, tick, out);
  return clamped;
}

}  // namespace evs
