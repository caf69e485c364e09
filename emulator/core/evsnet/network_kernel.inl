// The kernels of EvSNet for one instruction set (base/simd_target.h). The includer also defines
// EVS_KERNEL, the name of their table.
#pragma once

#include "evsnet/bilif.inl"
#include "evsnet/convolutions.inl"
#include "evsnet/log_delta.inl"
#include "evsnet/network_kernel.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Lanes outside the image copy its edge; their values never leave the kernel.
template <class T>
EVS_INLINE void load_tile(T* lanes, const T* image, const TilePlace& place) {
  const T* from = image + place.pixel;
  if (place.whole()) {
    for (int row = 0; row < TILE_SIDE; row++) {
      __builtin_memcpy(lanes + TILE_SIDE * row, from + static_cast<size_t>(row) * place.width,
                       sizeof(T) * TILE_SIDE);
    }
    return;
  }
  for (int i = 0; i < TILE_LANES; i++) {
    const int row = i / TILE_SIDE < place.rows ? i / TILE_SIDE : place.rows - 1;
    const int column = i % TILE_SIDE < place.columns ? i % TILE_SIDE : place.columns - 1;
    lanes[i] = from[static_cast<size_t>(row) * place.width + static_cast<size_t>(column)];
  }
}

template <class T>
EVS_INLINE void store_tile(const T* lanes, T* image, const TilePlace& place) {
  T* to = image + place.pixel;
  for (int row = 0; row < place.rows; row++) {
    T* line = to + static_cast<size_t>(row) * place.width;
    if (place.columns == TILE_SIDE) {
      __builtin_memcpy(line, lanes + TILE_SIDE * row, sizeof(T) * TILE_SIDE);
    } else {
      for (int column = 0; column < place.columns; column++)
        line[column] = lanes[TILE_SIDE * row + column];
    }
  }
}

// Luminance to the log intensity difference X, tile by tile.

// Lanes whose luminance changed or is unusable, as bits.
EVS_INLINE unsigned changed_lanes(Int now, Int before, Int limit) {
  // a float with its sign bit set is a negative integer
  return to_bits(~(now == before) | (now < splat(0)) | ~(now < limit));
}

// Mark the ticks in which a tile of this row of tiles changes.
void find_changes(const LogDeltaJob& job, size_t pixel, size_t width, int rows, uint32_t* ticks) {
  const Int limit = splat(static_cast<int>(job.unusable_from));
  const size_t whole = LANES < TILE_SIDE ? 0 : width / LANES * LANES;
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
      for (int i = 0; i < LANES / TILE_SIDE; i++) {
        if ((changed >> (i * TILE_SIDE) & 0xfu) != 0)
          ticks[x / TILE_SIDE + static_cast<size_t>(i)] |= bit;
      }
    }
    // the rest of the row, pixel by pixel
    for (size_t x = whole; x < width; x++) {
      for (int r = 0; r < rows; r++) {
        const size_t at = static_cast<size_t>(r) * width + x;
        uint32_t now, then;
        __builtin_memcpy(&now, frame + at, sizeof now);
        __builtin_memcpy(&then, before + at, sizeof then);
        if (now != then || now >= job.unusable_from) ticks[x / TILE_SIDE] |= bit;
      }
    }
  }
}

// X of a tile in each tick of the chunk.
uint32_t log_delta(const LogDeltaJob& job, const TilePlace& place, uint32_t changed, float* x,
                   int64_t* moved, LogDeltaCounts& counts) {
  alignas(64) float now[TICK_CHUNK * TILE_LANES], dn[TICK_CHUNK * TILE_LANES],
      part[TICK_CHUNK * TILE_LANES];
  alignas(64) float luminance[TILE_LANES], log[TILE_LANES];
  alignas(64) int last[TILE_LANES];
  // load the state of the tile
  load_tile(luminance, job.last_luminance, place);
  load_tile(log, job.last_log, place);
  const LogMap map = job.map;

  // take the logarithms of all changed ticks together, so that none waits for another
  int count = 0;
  for (uint32_t left = changed; left != 0; left &= left - 1) {
    const size_t t = static_cast<size_t>(__builtin_ctz(left));
    load_tile(now + TILE_LANES * count++, job.luminance + t * job.frame, place);
  }
  for (int at = 0; at < count * TILE_LANES; at += TILE_LANES) {
    for (int i = at; i < at + TILE_LANES; i++) dn[i] = to_dn(map, now[i]);
    for (int i = at; i < at + TILE_LANES; i++) part[i] = log_part<LogKind::LINLOG>(map, dn[i]);
  }

  uint32_t moved_ticks = 0;
  for (int first = 0; first < TILE_LANES; first += LANES) {
    const Mask inside = mask_from_bits(place.lanes() >> first);
    Float last_luminance = load(luminance + first), last_log = load(log + first);
    Int last_moved = splat(-1);
    int at = first;
    for (int t = 0; t < job.ticks; t++) {
      float* out = x + t * TILE_LANES + first;
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
      at += TILE_LANES;
    }
    store(luminance + first, last_luminance);
    store(log + first, last_log);
    store(last + first, last_moved);
  }
  // store the state of the tile
  store_tile(luminance, job.last_luminance, place);
  store_tile(log, job.last_log, place);
  for (int i = 0; i < TILE_LANES; i++) {
    if (last[i] >= 0) moved[i] = job.tick + last[i];
  }
  return moved_ticks;
}

// The membranes of the 16 pixels of a tile through a chunk.

// Kernel: the spikes of a tile in each tick of the chunk.
void integrate_and_fire(BiLifJob& job) {
  const BiLif& unit = *job.unit;
  job.fired = 0;
  job.v_clamped = 0;
  job.at_threshold = false;
  alignas(64) float v_lanes[TILE_LANES];
  alignas(64) int active_lanes[TILE_LANES];
  int64_t last[TILE_LANES];
  // load the state of the tile
  load_tile(v_lanes, job.v, job.place);
  load_tile(last, job.last, job.place);
  for (int i = 0; i < TILE_LANES; i++) {
    active_lanes[i] = relative_tick(last[i], job.tick);
  }
  for (int first = 0; first < TILE_LANES; first += LANES) {
    const Mask lanes = mask_from_bits(job.place.lanes() >> first);
    Float v = load(v_lanes + first);
    Int last_active = load(active_lanes + first);
    for (int t = 0; t < job.ticks; t++) {
      const Float current = load(job.current + t * TILE_LANES + first);
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
      store(job.leaked + t * TILE_LANES + first, fired.leaked);
      store(job.count + t * TILE_LANES + first, fired.count);
    }
    if (any(at_threshold(v, unit) & lanes)) job.at_threshold = true;
    store(v_lanes + first, v);
    store(active_lanes + first, last_active);
  }

  // store the state of the tile
  for (int i = 0; i < TILE_LANES; i++) {
    if (active_lanes[i] >= 0) last[i] = job.tick + active_lanes[i];
  }
  store_tile(v_lanes, job.v, job.place);
  store_tile(last, job.last, job.place);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE

namespace evs {

const NetworkKernel EVS_KERNEL = {EVS_NAMESPACE::find_changes, EVS_NAMESPACE::log_delta,
                                  EVS_NAMESPACE::infer, EVS_NAMESPACE::integrate_and_fire};

}  // namespace evs
