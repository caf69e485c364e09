// The photon noise of a block of pixels through one tick: which budgets last, in single precision.
//
// For each pixel one step over the whole tick (photon_noise.h). Pixels whose budget does not last,
// whose step is coarse, that are refractory or that stand still go through NoisyComparators.
#pragma once

#include <cstddef>
#include <cstdint>

#include "photon_noise.h"
#include "pixel_front_end.h"

namespace evs {

struct BudgetScratch {
  alignas(64) float decay[kBlock];
  alignas(64) float slow[kBlock];
  alignas(64) float shift[kBlock];
  alignas(64) float memory[kBlock];  // at the end of the tick
  alignas(64) float mean[kBlock];
  alignas(64) float passages[kBlock];  // of a rate of 1
  alignas(64) float sigma[2][kBlock];  // at the start and the end of the tick
  alignas(64) float above[2][kBlock];  // signal and mean noise over the reference
  alignas(64) float start[kBlock];     // of the nearer level, deviations
  alignas(64) float end[kBlock];
  alignas(64) float rates[kBlock];  // of first passages, at the start, the middle and the end
  alignas(64) float middle[kBlock];
  alignas(64) float last[kBlock];
  alignas(64) float fallen[kBlock];
  alignas(64) float random[kBlock];  // hazard
  alignas(64) float hazard[kBlock];  // with that of the moving levels
  alignas(64) uint32_t coarse[kBlock];
  alignas(64) uint64_t flags[kBlock];
};

// Add the hazard of one level of each pixel: of the nearer one, or of the other. Out: whether the
// other level of some pixel is near, too.
template <bool NEARER>
EVS_ALWAYS_INLINE bool add_hazard(const float* __restrict theta_on,
                                  const float* __restrict theta_off, size_t count,
                                  BudgetScratch& b) {
  uint32_t near = 0;
  for (size_t i = 0; i < count; i++) {
    const float on0 = theta_on[i] - b.above[0][i];
    const float on1 = theta_on[i] - b.above[1][i];
    const float off0 = theta_off[i] + b.above[0][i];
    const float off1 = theta_off[i] + b.above[1][i];
    const float on = select(on0 < on1, on0, on1);
    const float off = select(off0 < off1, off0, off1);
    const bool take_on = (on < off) == NEARER;
    b.start[i] = in_deviations(select(take_on, on0, off0), b.sigma[0][i]);
    b.end[i] = in_deviations(select(take_on, on1, off1), b.sigma[1][i]);
    if constexpr (NEARER) {
      const float other0 = in_deviations(select(take_on, off0, on0), b.sigma[0][i]);
      const float other1 = in_deviations(select(take_on, off1, on1), b.sigma[1][i]);
      near |= (other0 < kFarLevel) | (other1 < kFarLevel) ? 1u : 0u;
    }
  }
  const float* __restrict start = b.start;
  const float* __restrict end = b.end;
  const float* __restrict shift = b.shift;
  float* __restrict rates = b.rates;
  for (size_t i = 0; i < count; i++) rates[i] = passage_rate(shift[i], start[i]);
  for (size_t i = 0; i < count; i++) {
    const float middle = 0.5f * (start[i] + end[i]);
    b.middle[i] = passage_rate(shift[i], middle);
  }
  for (size_t i = 0; i < count; i++) b.last[i] = passage_rate(shift[i], end[i]);
  for (size_t i = 0; i < count; i++) {
    const float fallen = passage_loss(end[i]) - passage_loss(start[i]);
    b.fallen[i] = select(fallen > 0.0f, fallen, 0.0f);
  }
  for (size_t i = 0; i < count; i++) {
    const float x0 = b.start[i];
    const float x1 = b.end[i];
    const float sum = b.rates[i] + 4.0f * b.middle[i] + b.last[i];
    const float random = b.passages[i] * (sum * 0x1.555556p-3f);
    const float moving =
        select(x1 < static_cast<float>(kPassed), static_cast<float>(kCertain), b.fallen[i]);
    const float moved = x1 - x0;
    const bool far_away = (x0 >= kFarLevel) & (x1 >= kFarLevel);
    const uint32_t coarse = ((moved > 1.0f) | (moved < -1.0f)) & !far_away ? 1u : 0u;
    if constexpr (NEARER) {
      b.random[i] = random;
      b.hazard[i] = random + moving;
    } else {
      b.random[i] += random;
      b.hazard[i] += random + moving;
    }
    b.coarse[i] |= coarse;
  }
  return near != 0;
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
      b.shift[i] = level_shift(slower / faster);
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
    const float slow = b.slow[i];
    const float sigma = std::sqrt(scale * decay / dn[i]);
    const float kept = 1.0f - lowpass_a(decay);
    const float memory0 = memory[i];
    const float left = memory0 * kept;
    const bool forgotten = left < kForgotten;
    const float memory1 = select(forgotten, 0.0f, left);
    b.memory[i] = memory1;
    b.mean[i] = select(forgotten, 0.0f, mean[i] * kept);
    b.passages[i] = slow / (1.0f - memory0 * memory1 + 0x1p-24f);
    b.sigma[0][i] = sigma * unknown_share(memory0);
    b.sigma[1][i] = sigma * unknown_share(memory1);
    b.coarse[i] = (memory0 > kept) & (decay > 0.1f) ? 1u : 0u;
  }
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double sunk = drift == nullptr ? r : r - drift[i];
    b.above[0][i] = static_cast<float>(static_cast<double>(from[i]) - r) + mean[i];
    b.above[1][i] = static_cast<float>(static_cast<double>(to[i]) - sunk) + b.mean[i];
  }
  const bool other_is_near = add_hazard<true>(theta_on, theta_off, count, b);
  if (other_is_near) add_hazard<false>(theta_on, theta_off, count, b);
  const bool may_stand = !step.settings.references_follow();
  uint64_t any = 0;
  for (size_t i = 0; i < count; i++) {
    const double r = reference[i];
    const double before = budget[i];
    const double hazard = b.hazard[i];
    const bool still = may_stand & (memory[i] == 0.0f) & (from[i] == to[i]);
    const bool unclear =
        (b.coarse[i] != 0) & (static_cast<double>(b.random[i]) > kCoarseHazard * before);
    const bool candidate = (candidates >> i & 1) != 0;
    const bool lasts = (hazard < before) & (r == r) & !still & !unclear & !candidate;
    const double used = on_budget_grid(lasts ? hazard : 0.0);
    budget[i] = before - used;
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
