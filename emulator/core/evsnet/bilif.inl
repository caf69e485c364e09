// The bipolar leaky integrate-and-fire unit (BiLIF) of the 16 pixels of a tile, the paper's
// equations 2 and 3 with thresholds of their own for each polarity:
//
//   charge  V' = d V + I
//   fire    n spikes: ON if V' >= V_on, OFF if V' <= -V_off, else none
//   reset   V = V' - n V_on, V' + n V_off or V'
//
// n is the number of thresholds in V', but at most `most`: 1 in the paper. What is left stays in V.
//
// A pixel is active if I is not 0 or V is at a threshold. Only an active pixel changes; its leak
// over all ticks since it was last active is applied in one step. No NaN persists: as I it counts
// as 0 and as clamped, as V it becomes -64.
#pragma once

#include "network_kernel.h"
#include "tile.inl"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Mask at_threshold(Float v, const BiLif& unit) {
  return (v >= unit.v_on) | (v <= -unit.v_off);
}

// d^gap V of the active lanes.
EVS_INLINE Float leak(Float v, Int gap, Mask active, const BiLif& unit) {
  // nearly always one tick
  if (!any(active & ~(gap == splat(1)))) return v * unit.decay_low[1];
  const Mask far = ~(gap < splat(kDecayLow * kDecayHigh));
  const Int ticks = select(far | (gap < splat(0)), splat(0), gap);
  const Float low = gather(unit.decay_low, ticks & splat(kDecayLow - 1));
  const Float high = gather(unit.decay_high, shift_right<8>(ticks));
  return select(far, splat(0.0f), v * low * high);
}

// n of the lanes that fire, at least 1.
EVS_INLINE Float spikes(Float v, Mask on, Mask off, const BiLif& unit) {
  const Float one = splat(1.0f);
  if (unit.most == 1 || !any(on | off)) return one;
  const Float inside = select(on, v / splat(unit.v_on), select(off, -v / splat(unit.v_off), one));
  return to_float(truncate(min(inside, splat(static_cast<float>(unit.most)))));
}

// Kernel: the spikes of a tile in each tick of the chunk.
void integrate_and_fire(BiLifJob& job) {
  constexpr int64_t kFar = kDecayLow * kDecayHigh;
  const BiLif& unit = *job.unit;
  job.fired = 0;
  job.v_clamped = 0;
  job.at_threshold = false;
  alignas(64) float v_lanes[kLanes];
  alignas(64) int active_lanes[kLanes];
  int64_t last[kLanes];
  // load the state of the tile
  load_tile(v_lanes, job.v, job.place);
  load_tile(last, job.last, job.place);
  for (int i = 0; i < kLanes; i++) {
    // count from the first tick; older input has leaked away
    const int64_t relative = last[i] < job.tick - kFar ? -kFar : last[i] - job.tick;
    active_lanes[i] = static_cast<int>(relative > 0 ? 0 : relative);
  }
  for (int first = 0; first < kLanes; first += LANES) {
    const Mask lanes = mask_from_bits(job.place.lanes() >> first);
    Float v = load(v_lanes + first);
    Int last_active = load(active_lanes + first);
    for (int t = 0; t < job.ticks; t++) {
      const Float current = load(job.current + t * kLanes + first);
      // find the active lanes; a NaN is on neither side of 0
      const Mask no_current = (current <= 0.0f) & (current >= 0.0f);
      const Mask active = (~no_current | at_threshold(v, unit)) & lanes;
      if (!any(active)) continue;
      const Mask usable = (current <= 0.0f) | (current >= 0.0f);
      // charge
      const Float leaked = leak(v, splat(t) - last_active, active, unit);
      const Float charged = leaked + select(usable, current, splat(0.0f));
      const Float v_charged = min(max(charged, splat(-kLargestV)), splat(kLargestV));
      job.v_clamped += __builtin_popcount(to_bits(active & (~usable | (abs(charged) > kLargestV))));
      // fire
      const Mask on = active & (v_charged >= unit.v_on);
      const Mask off = active & (v_charged <= -unit.v_off);
      const Float count = spikes(v_charged, on, off, unit);
      // reset
      const Float reset = select(on, v_charged - count * unit.v_on,
                                 select(off, v_charged + count * unit.v_off, v_charged));
      v = select(active, reset, v);
      last_active = select(active, splat(t), last_active);
      // record the spikes
      const unsigned fired_on = to_bits(on), fired_off = to_bits(off);
      if ((fired_on | fired_off) == 0) continue;
      if ((job.fired >> t & 1u) == 0) job.on[t] = job.off[t] = 0;
      job.fired |= 1u << t;
      job.on[t] = static_cast<uint16_t>(job.on[t] | fired_on << first);
      job.off[t] = static_cast<uint16_t>(job.off[t] | fired_off << first);
      store(job.leaked + t * kLanes + first, leaked);
      store(job.count + t * kLanes + first, count);
    }
    if (any(at_threshold(v, unit) & lanes)) job.at_threshold = true;
    store(v_lanes + first, v);
    store(active_lanes + first, last_active);
  }

  // store the state of the tile
  for (int i = 0; i < kLanes; i++) {
    if (active_lanes[i] >= 0) last[i] = job.tick + active_lanes[i];
  }
  store_tile(v_lanes, job.v, job.place);
  store_tile(last, job.last, job.place);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
