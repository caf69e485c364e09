// The photon noise of a block of pixels through one tick: which budgets last, in single precision.
//
// Most pixels have no level within the reach of the noise, which one bound of its deviation tells:
// noise does not change their state. For each other pixel there is one step over the whole tick
// (photon_noise.h); those whose budget does not last, whose noise relaxes in the tick or that are
// refractory go through NoisyComparators. Those that stand still are in photon_noise_still.h.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "sensor/photon_noise.h"
#include "sensor/pixel_front_end.h"

namespace evs {

// Of still pixels that are packed: what StillNoise has of them.
struct StillScratch {
  alignas(64) float signal[BLOCK_PIXELS];
  alignas(64) double reference[BLOCK_PIXELS];
  alignas(64) double leak[BLOCK_PIXELS];
  alignas(64) double slow[BLOCK_PIXELS];
  alignas(64) double shift[BLOCK_PIXELS];
  alignas(64) double cell_end[BLOCK_PIXELS];  // us of the sensor's clock
  // deviations at the start and the end of the tick, and in the middle of the cell of time
  alignas(64) double on[2][BLOCK_PIXELS];
  alignas(64) double on_middle[BLOCK_PIXELS];
  alignas(64) double off_middle[BLOCK_PIXELS];
};

struct BudgetScratch {
  // of each pixel of the block: the signal over the reference at the start and the end
  alignas(64) float above[2][BLOCK_PIXELS];
  alignas(64) uint32_t reach[BLOCK_PIXELS];
  // pixels, packed
  size_t packed;
  alignas(64) uint32_t pixel[BLOCK_PIXELS];
  uint8_t place[BLOCK_PIXELS];  // of each pixel of the block, if it is packed
  alignas(64) float packed_dn[BLOCK_PIXELS];
  alignas(64) float theta_on[BLOCK_PIXELS];
  alignas(64) float theta_off[BLOCK_PIXELS];
  alignas(64) float packed_above[2][BLOCK_PIXELS];
  alignas(64) float old_memory[BLOCK_PIXELS];  // at the start of the tick
  alignas(64) float old_mean[BLOCK_PIXELS];
  alignas(64) float memory[BLOCK_PIXELS];  // at its end
  alignas(64) float mean[BLOCK_PIXELS];
  alignas(64) float decay[BLOCK_PIXELS];
  alignas(64) float slow[BLOCK_PIXELS];
  alignas(64) float shift[BLOCK_PIXELS];
  alignas(64) float precision[BLOCK_PIXELS];  // of the noise, 1 / variance
  alignas(64) float passages[BLOCK_PIXELS];   // of a rate of 1
  // of the deviation at the start and the end of the tick
  alignas(64) float inverse[2][BLOCK_PIXELS];
  alignas(64) float farthest[BLOCK_PIXELS];  // deviations
  // of the nearer level and the other one: deviations at the start and the end, and hazards
  alignas(64) float start[2][BLOCK_PIXELS];
  alignas(64) float end[2][BLOCK_PIXELS];
  alignas(64) float random[2][BLOCK_PIXELS];
  alignas(64) float moving[2][BLOCK_PIXELS];
  alignas(64) uint32_t on_is_nearer[BLOCK_PIXELS];
  alignas(64) uint32_t relaxes[BLOCK_PIXELS];
  alignas(64) double budget[BLOCK_PIXELS];
  alignas(64) double left[BLOCK_PIXELS];  // of it; -1: it does not last
  StillScratch still;
};

struct LevelHazard {
  float random, moving;
};

// The hazard of a level that goes from x0 to x1 deviations.
EVS_ALWAYS_INLINE LevelHazard level_hazard(float x0, float x1, float shift, float passages) {
  const float x = select(x0 < x1, x0, x1);
  const float fallen = select(x1 < x0, x0 - x1, 0.0f);
  const float risen = select(x1 < x0, 0.0f, x1 - x0);
  const float above = select(x > -3.0f, x, -3.0f);
  const float within = select(above < 7.0f, above, 7.0f);
  const float slope = loss_slope(within);
  const float mean = mean_over_way(within, slope, fallen + risen);
  const float level = shifted_level(shift, within);
  const float rate = one_pole_rate(select(level < 7.0f, level, 7.0f));
  const bool near = x < FAR_LEVEL;
  const float moving = select(near, slope * fallen * mean, 0.0f);
  return {select(near, passages * rate * mean, 0.0f),
          select(x1 < static_cast<float>(PASSED), static_cast<float>(CERTAIN), moving)};
}

// The pixels of a block, as bits, by what noise may do to them.
struct NoiseReach {
  uint64_t moving = 0;  // a level is within reach, or the noise is known in part, or no reference
  uint64_t still = 0;   // a level is within reach, but neither signal nor noise move
};

// Find the pixels that noise may reach. The others have no memory of it and all levels beyond
// FAR_LEVEL, and beyond the margin of StillNoise::far, so that no budget changes: sigma^2 DN is at
// most scale times the slower pole.
EVS_ALWAYS_INLINE NoiseReach within_reach(const PixelStep& step, size_t first, size_t count,
                                          const float* __restrict dn, Signal signal,
                                          const double* __restrict reference,
                                          const double* __restrict drift, BudgetScratch& b) {
  constexpr float REACH = (FAR_LEVEL + 0.6f) * (FAR_LEVEL + 0.6f);
  // thresholds are at most 20, and so is a signal between them: single precision moves no distance
  // by more
  constexpr float ROUNDING = 0x1p-15f;
  const float* __restrict memory = step.arrays.noise_memory + first;
  const float* __restrict theta_on = step.pattern.theta_on + first;
  const float* __restrict theta_off = step.pattern.theta_off + first;
  const float* __restrict from = signal.from;
  const float* __restrict to = signal.to;
  const bool photoreceptor = step.settings.lowpass();
  const float low = photoreceptor ? step.lowpass_low : LONGEST;
  const float slope = photoreceptor ? step.lowpass_slope : 0.0f;
  const float fastest = step.settings.follower > 0.0 ? step.follower_z : LONGEST;
  const float scale = REACH * step.photon_scale;
  const bool may_stand = !step.settings.references_follow();
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double sunk = drift == nullptr ? r : r - drift[i];
    const float above0 = static_cast<float>(static_cast<double>(from[i]) - r);
    const float above1 = static_cast<float>(static_cast<double>(to[i]) - sunk);
    const float highest = select(above0 > above1, above0, above1);
    const float lowest = select(above0 > above1, above1, above0);
    const float on = theta_on[i] - highest;
    const float off = theta_off[i] + lowest;
    const float distance = select(on < off, on, off) - ROUNDING;
    const float z = low + slope * dn[i];
    const float slower = select(z < fastest, z, fastest);
    // 2^-100 and 2^-70: no product of denormals, and more than is added to a variance below
    const float variance = scale * (slower + 0x1p-100f) + 0x1p-70f;
    const bool forgot = memory[i] == 0.0f;
    const bool far = forgot & (distance > 0.0f) & (distance * distance * dn[i] > variance);
    const bool still = forgot & may_stand & (from[i] == to[i]);
    b.above[0][i] = above0;
    b.above[1][i] = above1;
    b.reach[i] = far ? 0u : still ? 2u : 1u;
  }
  NoiseReach reach;
  for (size_t i = 0; i < count; i++) {
    reach.moving |= static_cast<uint64_t>(b.reach[i] & 1u) << i;
    reach.still |= static_cast<uint64_t>(b.reach[i] >> 1) << i;
  }
  return reach;
}

// Pack pixels, filled up to a multiple of some lanes with copies of the first.
EVS_ALWAYS_INLINE size_t pack_pixels(uint64_t pixels, size_t lanes, BudgetScratch& b) {
  b.packed = 0;
  for (; pixels != 0; pixels &= pixels - 1) {
    const int i = std::countr_zero(pixels);
    b.place[i] = static_cast<uint8_t>(b.packed);
    b.pixel[b.packed++] = static_cast<uint32_t>(i);
  }
#ifdef EVS_ON_DEVICE
  lanes = 1;  // a thread has no registers to fill
#endif
  const size_t filled = (b.packed + lanes - 1) & ~(lanes - 1);
  for (size_t k = b.packed; k < filled; k++) b.pixel[k] = b.pixel[0];
  return filled;
}

// The levels of each packed pixel, the nearer one first. Out: whether noise may reach any of the
// others.
EVS_ALWAYS_INLINE bool order_levels(size_t count, BudgetScratch& b) {
  uint32_t near = 0;
  for (size_t k = 0; k < count; k++) {
    const float inverse0 = b.inverse[0][k];
    const float inverse1 = b.inverse[1][k];
    const float farthest = b.farthest[k];
    const float above0 = b.packed_above[0][k] + b.old_mean[k];
    const float above1 = b.packed_above[1][k] + b.mean[k];
    const float on0 = in_deviations((b.theta_on[k] - above0) * inverse0, farthest);
    const float on1 = in_deviations((b.theta_on[k] - above1) * inverse1, farthest);
    const float off0 = in_deviations((b.theta_off[k] + above0) * inverse0, farthest);
    const float off1 = in_deviations((b.theta_off[k] + above1) * inverse1, farthest);
    const float on = select(on0 < on1, on0, on1);
    const float off = select(off0 < off1, off0, off1);
    const bool is_on = on < off;
    b.on_is_nearer[k] = is_on ? 1u : 0u;
    b.start[0][k] = select(is_on, on0, off0);
    b.end[0][k] = select(is_on, on1, off1);
    b.start[1][k] = select(is_on, off0, on0);
    b.end[1][k] = select(is_on, off1, on1);
    near |= select(is_on, off, on) < FAR_LEVEL ? 1u : 0u;
  }
  return near != 0;
}

EVS_ALWAYS_INLINE void add_levels(size_t which, size_t count, BudgetScratch& b) {
  const float* __restrict start = b.start[which];
  const float* __restrict end = b.end[which];
  for (size_t k = 0; k < count; k++) {
    const LevelHazard hazard = level_hazard(start[k], end[k], b.shift[k], b.passages[k]);
    b.random[which][k] = hazard.random;
    b.moving[which][k] = hazard.moving;
  }
}

// The band of a packed pixel and its step over the whole tick, at whose end there is `signal1`.
inline NoiseBand noise_band_of(const BudgetScratch& b, size_t k, uint32_t tick_us) {
  const double us = tick_us;
  return {1.0 / std::sqrt(b.precision[k]), b.decay[k] / us, b.slow[k] / us, b.shift[k]};
}

inline NoiseStep noise_step(const BudgetScratch& b, size_t k, double signal1) {
  auto level = [&](size_t which) {
    return NoiseLevel{b.start[which][k], b.end[which][k], b.random[which][k], b.moving[which][k]};
  };
  const size_t on = b.on_is_nearer[k] != 0 ? 0 : 1;
  return {b.memory[k], b.mean[k], signal1, b.passages[k], level(on), level(1 - on)};
}

// Use up the budgets of pixels of a block, given as bits. In: `candidates`, those of them that are
// left in any case. Out: those, as bits, that are left to NoisyComparators, and whose state is as
// before.
EVS_ALWAYS_INLINE uint64_t use_up_moving(const PixelStep& step, size_t first, uint64_t pixels,
                                         uint64_t candidates, const float* dn,
                                         const double* reference, BudgetScratch& b) {
  float* mean = step.arrays.noise_mean + first;
  float* memory = step.arrays.noise_memory + first;
  double* budget = step.arrays.noise_budget + first;
  const float* theta_on = step.pattern.theta_on + first;
  const float* theta_off = step.pattern.theta_off + first;
  const size_t count = pack_pixels(pixels, 16, b);
  for (size_t k = 0; k < count; k++) {
    const uint32_t i = b.pixel[k];
    b.packed_dn[k] = dn[i];
    b.theta_on[k] = theta_on[i];
    b.theta_off[k] = theta_off[i];
    b.packed_above[0][k] = b.above[0][i];
    b.packed_above[1][k] = b.above[1][i];
    b.old_memory[k] = memory[i];
    b.old_mean[k] = mean[i];
    b.budget[k] = budget[i];
  }
  const bool photoreceptor = step.settings.lowpass();
  const float low = step.lowpass_low;
  const float slope = step.lowpass_slope;
  const float follower_z = step.follower_z;
  const float scale = step.photon_scale;
  // the poles, as z
  if (photoreceptor && step.settings.follower > 0.0) {
    for (size_t k = 0; k < count; k++) {
      const float z = low + slope * b.packed_dn[k];
      const float slower = z < follower_z ? z : follower_z;
      const float faster = z < follower_z ? follower_z : z;
      b.decay[k] = z * follower_z / (z + follower_z);
      b.slow[k] = slower;
      b.shift[k] = level_shift(slower, faster);
    }
  } else {
    for (size_t k = 0; k < count; k++) {
      const float z = photoreceptor ? low + slope * b.packed_dn[k] : follower_z;
      b.decay[k] = z;
      b.slow[k] = z;
      b.shift[k] = 0.0f;
    }
  }
  for (size_t k = 0; k < count; k++) {
    const float decay = b.decay[k];
    const float precision = b.packed_dn[k] / (scale * decay + 1e-24f);  // 1 / sigma^2
    const float kept = 1.0f - lowpass_a(decay);
    const float memory0 = b.old_memory[k];
    const float left = memory0 * kept;
    const bool forgotten = left < FORGOTTEN;
    const float memory1 = select(forgotten, 0.0f, left);
    b.memory[k] = memory1;
    b.mean[k] = select(forgotten, 0.0f, b.old_mean[k] * kept);
    const float unknown0 = (1.0f - memory0) * (1.0f + memory0) + 0x1p-24f;
    const float unknown1 = 1.0f / ((1.0f - memory1) * (1.0f + memory1) + 0x1p-24f);
    b.precision[k] = precision;
    b.passages[k] = b.slow[k] * unknown1;
    b.inverse[0][k] = std::sqrt(precision / unknown0);
    b.inverse[1][k] = std::sqrt(precision * unknown1);
    b.farthest[k] = farthest_level(memory0);
    b.relaxes[k] = ((memory0 > kept) & (decay > 0.1f)) ? 1u : 0u;
  }
  const bool both = order_levels(count, b);
  add_levels(0, count, b);
  if (both) {
    add_levels(1, count, b);
  } else {
    for (size_t k = 0; k < count; k++) b.random[1][k] = b.moving[1][k] = 0.0f;
  }
  for (size_t k = 0; k < count; k++) {
    const float random = b.random[0][k] + b.random[1][k];
    const float hazard = random + (b.moving[0][k] + b.moving[1][k]);
    const float relaxing = select(b.relaxes[k] != 0, random * COARSE_PARTS, 0.0f);
    const double least = static_cast<double>(select(relaxing > hazard, relaxing, hazard));
    const double left = budget_left(b.budget[k], static_cast<double>(hazard));
    b.left[k] = select(least < b.budget[k], left, -1.0);
  }
  uint64_t left = 0;
  for (size_t k = 0; k < b.packed; k++) {
    const uint32_t i = b.pixel[k];
    if ((b.left[k] > 0.0) & (reference[i] == reference[i]) & ((candidates >> i & 1) == 0)) {
      budget[i] = b.left[k];
      memory[i] = b.memory[k];
      mean[i] = b.mean[k];
    } else {
      left |= uint64_t{1} << i;
    }
  }
  return left;
}

}  // namespace evs
