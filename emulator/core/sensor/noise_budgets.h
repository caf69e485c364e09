// The photon noise of a block of pixels through one tick: which budgets last, in single precision.
//
// For each pixel one step over the whole tick (photon_noise.h). Pixels whose budget does not last,
// whose noise relaxes in the tick, that are refractory or that stand still go through
// NoisyComparators.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "sensor/photon_noise.h"
#include "sensor/pixel_front_end.h"

namespace evs {

struct BudgetScratch {
  alignas(64) float decay[BLOCK_PIXELS];
  alignas(64) float slow[BLOCK_PIXELS];
  alignas(64) float shift[BLOCK_PIXELS];
  alignas(64) float memory[BLOCK_PIXELS];  // at the end of the tick
  alignas(64) float mean[BLOCK_PIXELS];
  alignas(64) float passages[BLOCK_PIXELS];  // of a rate of 1
  alignas(
      64) float inverse[2][BLOCK_PIXELS];  // of the deviation at the start and the end of the tick
  alignas(64) float farthest[BLOCK_PIXELS];   // deviations
  alignas(64) float above[2][BLOCK_PIXELS];   // signal and mean noise over the reference
  alignas(64) float precision[BLOCK_PIXELS];  // of the noise, 1 / variance
  // of the nearer level and the other one: deviations at the start and the end, and hazards
  alignas(64) float start[2][BLOCK_PIXELS];
  alignas(64) float end[2][BLOCK_PIXELS];
  alignas(64) float random[2][BLOCK_PIXELS];
  alignas(64) float moving[2][BLOCK_PIXELS];
  alignas(64) uint32_t on_is_nearer[BLOCK_PIXELS];
  alignas(64) uint32_t relaxes[BLOCK_PIXELS];
  alignas(64) float hazard[BLOCK_PIXELS];
  alignas(64) float least[BLOCK_PIXELS];  // budget that lasts
  alignas(64) uint64_t flags[BLOCK_PIXELS];
  // some levels, packed
  size_t packed;
  alignas(64) uint32_t pixel[BLOCK_PIXELS];
  alignas(64) float packed_start[BLOCK_PIXELS];
  alignas(64) float packed_end[BLOCK_PIXELS];
  alignas(64) float packed_shift[BLOCK_PIXELS];
  alignas(64) float packed_passages[BLOCK_PIXELS];
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

// The levels of each pixel. Out: for the nearer level (0) and the other one (1), which ones noise
// may reach, as bits.
struct NearLevels {
  uint64_t near[2];
};

EVS_ALWAYS_INLINE NearLevels order_levels(const float* __restrict theta_on,
                                          const float* __restrict theta_off, size_t count,
                                          BudgetScratch& b) {
  alignas(64) uint32_t is_near[2][BLOCK_PIXELS];
  for (size_t i = 0; i < count; i++) {
    const float inverse0 = b.inverse[0][i];
    const float inverse1 = b.inverse[1][i];
    const float farthest = b.farthest[i];
    const float on0 = in_deviations((theta_on[i] - b.above[0][i]) * inverse0, farthest);
    const float on1 = in_deviations((theta_on[i] - b.above[1][i]) * inverse1, farthest);
    const float off0 = in_deviations((theta_off[i] + b.above[0][i]) * inverse0, farthest);
    const float off1 = in_deviations((theta_off[i] + b.above[1][i]) * inverse1, farthest);
    const float on = select(on0 < on1, on0, on1);
    const float off = select(off0 < off1, off0, off1);
    const bool is_on = on < off;
    b.on_is_nearer[i] = is_on ? 1u : 0u;
    b.start[0][i] = select(is_on, on0, off0);
    b.end[0][i] = select(is_on, on1, off1);
    b.start[1][i] = select(is_on, off0, on0);
    b.end[1][i] = select(is_on, off1, on1);
    is_near[0][i] = select(is_on, on, off) < FAR_LEVEL ? 1u : 0u;
    is_near[1][i] = select(is_on, off, on) < FAR_LEVEL ? 1u : 0u;
  }
  NearLevels levels{};
  for (size_t i = 0; i < count; i++) {
    levels.near[0] |= static_cast<uint64_t>(is_near[0][i]) << i;
    levels.near[1] |= static_cast<uint64_t>(is_near[1][i]) << i;
  }
  return levels;
}

EVS_ALWAYS_INLINE void add_all_levels(size_t which, size_t count, BudgetScratch& b) {
  const float* __restrict start = b.start[which];
  const float* __restrict end = b.end[which];
  for (size_t i = 0; i < count; i++) {
    const LevelHazard hazard = level_hazard(start[i], end[i], b.shift[i], b.passages[i]);
    b.random[which][i] = hazard.random;
    b.moving[which][i] = hazard.moving;
  }
}

EVS_ALWAYS_INLINE void add_packed_levels(size_t which, uint64_t near, size_t count,
                                         BudgetScratch& b) {
  alignas(64) float random[BLOCK_PIXELS];
  alignas(64) float moving[BLOCK_PIXELS];
  for (size_t i = 0; i < count; i++) b.random[which][i] = b.moving[which][i] = 0.0f;
  b.packed = 0;
  for (; near != 0; near &= near - 1) {
    const size_t i = static_cast<size_t>(std::countr_zero(near));
    const size_t k = b.packed++;
    b.pixel[k] = static_cast<uint32_t>(i);
    b.packed_start[k] = b.start[which][i];
    b.packed_end[k] = b.end[which][i];
    b.packed_shift[k] = b.shift[i];
    b.packed_passages[k] = b.passages[i];
  }
  for (size_t k = 0; k < b.packed; k++) {
    const LevelHazard hazard =
        level_hazard(b.packed_start[k], b.packed_end[k], b.packed_shift[k], b.packed_passages[k]);
    random[k] = hazard.random;
    moving[k] = hazard.moving;
  }
  for (size_t k = 0; k < b.packed; k++) {
    b.random[which][b.pixel[k]] = random[k];
    b.moving[which][b.pixel[k]] = moving[k];
  }
}

// The band of a pixel and its step over the whole tick.
inline NoiseBand noise_band_of(const BudgetScratch& b, size_t i, uint32_t tick_us) {
  const double us = tick_us;
  return {1.0 / std::sqrt(b.precision[i]), b.decay[i] / us, b.slow[i] / us, b.shift[i]};
}

inline NoiseStep noise_step(const BudgetScratch& b, size_t i) {
  auto level = [&](size_t which) {
    return NoiseLevel{b.start[which][i], b.end[which][i], b.random[which][i], b.moving[which][i]};
  };
  const size_t on = b.on_is_nearer[i] != 0 ? 0 : 1;
  return {b.memory[i], b.mean[i], b.passages[i], level(on), level(1 - on)};
}

// Use up the budgets of a block. In: the signal; the references at the start of the tick and by how
// much they sink in it (null: not at all); `candidates`, pixels that are left in any case. Out: the
// pixels, as bits, that are left to NoisyComparators, and whose state is as before.
EVS_ALWAYS_INLINE uint64_t use_up_budgets(const PixelStep& step, size_t first, size_t count,
                                          const float* __restrict dn, Signal signal,
                                          const double* __restrict reference,
                                          const double* __restrict drift, uint64_t candidates,
                                          BudgetScratch& b) {
  float* __restrict mean = step.arrays.noise_mean + first;
  float* __restrict memory = step.arrays.noise_memory + first;
  double* __restrict budget = step.arrays.noise_budget + first;
  const float* __restrict theta_on = step.pattern.theta_on + first;
  const float* __restrict theta_off = step.pattern.theta_off + first;
  const float* __restrict from = signal.from;
  const float* __restrict to = signal.to;
  const bool photoreceptor = step.settings.lowpass();
  const bool follower = step.settings.follower > 0.0;
  const float low = step.lowpass_low;
  const float slope = step.lowpass_slope;
  const float follower_z = step.follower_z;
  const float scale = step.photon_scale;
  // the poles, as z
  if (photoreceptor && follower) {
    for (size_t i = 0; i < count; i++) {
      const float z = low + slope * dn[i];
      const float slower = z < follower_z ? z : follower_z;
      const float faster = z < follower_z ? follower_z : z;
      b.decay[i] = z * follower_z / (z + follower_z);
      b.slow[i] = slower;
      b.shift[i] = level_shift(slower, faster);
    }
  } else {
    for (size_t i = 0; i < count; i++) {
      const float z = photoreceptor ? low + slope * dn[i] : follower_z;
      b.decay[i] = z;
      b.slow[i] = z;
      b.shift[i] = 0.0f;
    }
  }
  for (size_t i = 0; i < count; i++) {
    const float decay = b.decay[i];
    const float precision = dn[i] / (scale * decay + 1e-24f);  // 1 / sigma^2
    const float kept = 1.0f - lowpass_a(decay);
    const float memory0 = memory[i];
    const float left = memory0 * kept;
    const bool forgotten = left < FORGOTTEN;
    const float memory1 = select(forgotten, 0.0f, left);
    b.memory[i] = memory1;
    b.mean[i] = select(forgotten, 0.0f, mean[i] * kept);
    const float unknown0 = (1.0f - memory0) * (1.0f + memory0) + 0x1p-24f;
    const float unknown1 = 1.0f / ((1.0f - memory1) * (1.0f + memory1) + 0x1p-24f);
    b.precision[i] = precision;
    b.passages[i] = b.slow[i] * unknown1;
    b.inverse[0][i] = std::sqrt(precision / unknown0);
    b.inverse[1][i] = std::sqrt(precision * unknown1);
    b.farthest[i] = farthest_level(memory0);
    b.relaxes[i] = ((memory0 > kept) & (decay > 0.1f)) ? 1u : 0u;
  }
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double sunk = drift == nullptr ? r : r - drift[i];
    b.above[0][i] = static_cast<float>(static_cast<double>(from[i]) - r) + mean[i];
    b.above[1][i] = static_cast<float>(static_cast<double>(to[i]) - sunk) + b.mean[i];
  }
  const NearLevels levels = order_levels(theta_on, theta_off, count, b);
  if (static_cast<size_t>(std::popcount(levels.near[0])) > count / 2) {
    add_all_levels(0, count, b);
  } else {
    add_packed_levels(0, levels.near[0], count, b);
  }
  add_packed_levels(1, levels.near[1], count, b);
  // a hazard that no budget lasts for leaves a pixel to NoisyComparators
  const bool may_stand = !step.settings.references_follow();
  float* __restrict least = b.least;
  float* __restrict hazards = b.hazard;
  for (size_t i = 0; i < count; i++) {
    const bool still = may_stand & (memory[i] == 0.0f) & (from[i] == to[i]);
    const float random = b.random[0][i] + b.random[1][i];
    const float hazard = random + (b.moving[0][i] + b.moving[1][i]);
    const float relaxing = select(b.relaxes[i] != 0, random * COARSE_PARTS, 0.0f);
    hazards[i] = hazard;
    least[i] = select(still, BEYOND_BUDGETS, select(relaxing > hazard, relaxing, hazard));
  }
  for (uint64_t each = candidates; each != 0; each &= each - 1) {
    least[std::countr_zero(each)] = BEYOND_BUDGETS;
  }
  uint64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double before = budget[i];
    const bool lasts = (static_cast<double>(least[i]) < before) & (r == r);
    budget[i] = select(lasts, budget_left(before, static_cast<double>(hazards[i])), before);
    b.flags[i] = lasts ? 0 : 1;
    any |= b.flags[i];
  }
  uint64_t left = 0;
  if (any != 0) {
    for (size_t i = 0; i < count; i++) left |= b.flags[i] << i;
  }
  for (size_t i = 0; i < count; i++) {
    const bool lasts = b.flags[i] == 0;
    memory[i] = select(lasts, b.memory[i], memory[i]);
    mean[i] = select(lasts, b.mean[i], mean[i]);
  }
  return left;
}

}  // namespace evs
