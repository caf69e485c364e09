// Luminance to the log intensity difference X, tile by tile.
#pragma once

#include "evsnet/log_delta_lanes.inl"
#include "evsnet/network_kernel.h"
#include "evsnet/tile.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Lanes whose luminance changed or is unusable, as bits.
EVS_INLINE unsigned changed_lanes(Int now, Int before, Int limit) {
  // a float with its sign bit set is a negative integer
  return to_bits(~(now == before) | (now < splat(0)) | ~(now < limit));
}

// Mark the ticks in which a tile of this row of tiles changes.
void find_changes(const LogDeltaJob& job, size_t pixel, size_t width, int rows, uint32_t* ticks) {
  const Int limit = splat(static_cast<int>(job.unusable_from));
  const size_t whole = LANES < kTileSide ? 0 : width / LANES * LANES;
  for (int t = 0; t < job.ticks; t++) {
    const float* frame = job.luminance + static_cast<size_t>(t) * job.frame + pixel;
    const float* before = t == 0 ? job.last_luminance + pixel : frame - job.frame;
    const uint32_t bit = 1u << t;
    // whole registers: four tiles at once
    for (size_t x = 0; x < whole; x += LANES) {
      unsigned changed = 0;
      for (int r = 0; r < rows; r++) {
        const size_t at = static_cast<size_t>(r) * width + x;
        changed |= changed_lanes(as_int(load(frame + at)), as_int(load(before + at)), limit);
      }
      if (changed == 0) continue;
      for (int i = 0; i < LANES / kTileSide; i++) {
        if ((changed >> (i * kTileSide) & 0xfu) != 0)
          ticks[x / kTileSide + static_cast<size_t>(i)] |= bit;
      }
    }
    // the rest of the row, pixel by pixel
    for (size_t x = whole; x < width; x++) {
      for (int r = 0; r < rows; r++) {
        const size_t at = static_cast<size_t>(r) * width + x;
        uint32_t now, then;
        __builtin_memcpy(&now, frame + at, sizeof now);
        __builtin_memcpy(&then, before + at, sizeof then);
        if (now != then || now >= job.unusable_from) ticks[x / kTileSide] |= bit;
      }
    }
  }
}

// X of a tile in each tick of the chunk.
uint32_t log_delta(const LogDeltaJob& job, const TilePlace& place, uint32_t changed, float* x,
                   int64_t* moved, LogDeltaCounts& counts) {
  alignas(64) float now[kChunk * kLanes], dn[kChunk * kLanes], part[kChunk * kLanes];
  alignas(64) float luminance[kLanes], log[kLanes];
  alignas(64) int last[kLanes];
  // load the state of the tile
  load_tile(luminance, job.last_luminance, place);
  load_tile(log, job.last_log, place);
  const LogMap map = job.map;

  // take the logarithms of all changed ticks together, so that none waits for another
  int count = 0;
  for (uint32_t left = changed; left != 0; left &= left - 1) {
    const size_t t = static_cast<size_t>(__builtin_ctz(left));
    load_tile(now + kLanes * count++, job.luminance + t * job.frame, place);
  }
  for (int at = 0; at < count * kLanes; at += kLanes) {
    for (int i = at; i < at + kLanes; i++) dn[i] = to_dn(map, now[i]);
    for (int i = at; i < at + kLanes; i++) part[i] = log_part<LogKind::linlog>(map, dn[i]);
  }

  uint32_t moved_ticks = 0;
  for (int first = 0; first < kLanes; first += LANES) {
    const Mask inside = mask_from_bits(place.lanes() >> first);
    Float last_luminance = load(luminance + first), last_log = load(log + first);
    Int last_moved = splat(-1);
    int at = first;
    for (int t = 0; t < job.ticks; t++) {
      float* out = x + t * kLanes + first;
      if ((changed >> t & 1u) == 0) {
        store(out, splat(0.0f));
        continue;
      }
      const LogDelta delta = log_delta_lanes(map, load(now + at), load(dn + at), load(part + at),
                                             inside, last_luminance, last_log);
      store(out, delta.x);
      last_moved = select(delta.nonzero, splat(t), last_moved);
      moved_ticks |= (any(delta.nonzero) ? 1u : 0u) << t;
      counts.x_clamped += __builtin_popcount(to_bits(~delta.unclamped));
      counts.clamped += __builtin_popcount(to_bits(~delta.usable & inside));
      at += kLanes;
    }
    store(luminance + first, last_luminance);
    store(log + first, last_log);
    store(last + first, last_moved);
  }
  // store the state of the tile
  store_tile(luminance, job.last_luminance, place);
  store_tile(log, job.last_log, place);
  for (int i = 0; i < kLanes; i++) {
    if (last[i] >= 0) moved[i] = job.tick + last[i];
  }
  return moved_ticks;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
