// The bipolar leaky integrate-and-fire unit (BiLIF) of one register of lanes, the paper's equations
// 2 and 3 with thresholds of their own for each polarity:
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

#include "base/simd.inl"
#include "evsnet/network_kernel.h"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Mask at_threshold(Float v, const BiLif& unit) {
  return (v >= unit.v_on) | (v <= -unit.v_off);
}

// d^gap V of the active lanes.
EVS_INLINE Float leak(Float v, Int gap, Mask active, const BiLif& unit) {
  // nearly always one tick
  if (!any(active & ~(gap == splat(1)))) return v * unit.decay_low[1];
  const Mask far = ~(gap < splat(DECAY_LOW * DECAY_HIGH));
  const Int ticks = select(far | (gap < splat(0)), splat(0), gap);
  const Float low = gather(unit.decay_low, ticks & splat(DECAY_LOW - 1));
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

// What a tick does to the membranes of a register of lanes.
struct Fired {
  Mask on, off;  // lanes that fire
  Mask clamped;  // lanes whose current is a NaN, or whose V was clamped
  Float leaked;  // d V at the start of the tick
  Float count;   // spikes of the lanes that fire
};

// The tick `last`, counted from `tick`; older input has leaked away.
EVS_INLINE int relative_tick(int64_t last, int64_t tick) {
  constexpr int64_t FAR_AWAY = DECAY_LOW * DECAY_HIGH;
  const int64_t relative = last < tick - FAR_AWAY ? -FAR_AWAY : last - tick;
  return static_cast<int>(relative > 0 ? 0 : relative);
}

// Tick t, counted as last_active is. In/out: `v` and `last_active` of the active lanes. Returns
// whether there are any; without, `fired` is not written.
EVS_INLINE bool integrate_and_fire_lanes(const BiLif& unit, Float current, int t, Mask lanes,
                                         Float& v, Int& last_active, Fired& fired) {
  // find the active lanes; a NaN is on neither side of 0
  const Mask no_current = (current <= 0.0f) & (current >= 0.0f);
  const Mask active = (~no_current | at_threshold(v, unit)) & lanes;
  if (!any(active)) return false;
  const Mask usable = (current <= 0.0f) | (current >= 0.0f);
  // charge
  fired.leaked = leak(v, splat(t) - last_active, active, unit);
  const Float charged = fired.leaked + select(usable, current, splat(0.0f));
  const Float v_charged = min(max(charged, splat(-LARGEST_V)), splat(LARGEST_V));
  fired.clamped = active & (~usable | (abs(charged) > LARGEST_V));
  // fire
  fired.on = active & (v_charged >= unit.v_on);
  fired.off = active & (v_charged <= -unit.v_off);
  fired.count = spikes(v_charged, fired.on, fired.off, unit);
  // reset
  const Float reset = select(fired.on, v_charged - fired.count * unit.v_on,
                             select(fired.off, v_charged + fired.count * unit.v_off, v_charged));
  v = select(active, reset, v);
  last_active = select(active, splat(t), last_active);
  return true;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
