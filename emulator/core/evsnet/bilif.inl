// The membranes of the 16 pixels of a tile through a chunk.
#pragma once

#include "evsnet/bilif_lanes.inl"
#include "evsnet/network_kernel.h"
#include "evsnet/tile.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Kernel: the spikes of a tile in each tick of the chunk.
void integrate_and_fire(BiLifJob& job) {
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
    active_lanes[i] = relative_tick(last[i], job.tick);
  }
  for (int first = 0; first < kLanes; first += LANES) {
    const Mask lanes = mask_from_bits(job.place.lanes() >> first);
    Float v = load(v_lanes + first);
    Int last_active = load(active_lanes + first);
    for (int t = 0; t < job.ticks; t++) {
      const Float current = load(job.current + t * kLanes + first);
      Fired fired;
      if (!integrate_and_fire_lanes(unit, current, t, lanes, v, last_active, fired)) continue;
      job.v_clamped += __builtin_popcount(to_bits(fired.clamped));
      // record the spikes
      const unsigned fired_on = to_bits(fired.on), fired_off = to_bits(fired.off);
      if ((fired_on | fired_off) == 0) continue;
      if ((job.fired >> t & 1u) == 0) job.on[t] = job.off[t] = 0;
      job.fired |= 1u << t;
      job.on[t] = static_cast<uint16_t>(job.on[t] | fired_on << first);
      job.off[t] = static_cast<uint16_t>(job.off[t] | fired_off << first);
      store(job.leaked + t * kLanes + first, fired.leaked);
      store(job.count + t * kLanes + first, fired.count);
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
