// Retracing dirty samples: units are collected into full packets, traced, and stored in the cache.
#pragma once

#include "incremental/cached_hits.inl"
#include "integrators/wavefront.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Up to a packet of units.
struct SampleUnits {
  int count = 0;
  alignas(64) int x[LANES] = {}, y[LANES] = {}, unit[LANES] = {};

  void add(int column, int row, int index) {
    x[count] = column;
    y[count] = row;
    unit[count++] = index;
  }
  // Return the lanes in use; the others repeat the last unit.
  Mask fill() {
    for (int i = count; i < LANES; i++) {
      x[i] = x[count - 1];
      y[i] = y[count - 1];
      unit[i] = unit[count - 1];
    }
    return mask_from_bits(first_lanes(count));
  }
};

// A batch of dirty units: those pending until their packet is full, those being traced, and expired
// ones to recheck.
struct DirtyBatch {
  Wavefront front;
  int packets = 0;
  long traced = 0;  // samples
  SampleUnits pending = {}, expired = {};
};

EVS_INLINE Float valid_until(const PathCacheView& cache, Float gap) {
  return (gap + cache.motion) * 0.999999f;
}

// Return the OR over `lanes`.
inline unsigned reduce_or(Int a, unsigned lanes) {
  alignas(64) int each[LANES];
  store(each, a);
  unsigned all = 0;
  for (; lanes; lanes &= lanes - 1) all |= static_cast<unsigned>(each[first_lane(lanes)]);
  return all;
}

// Scatter the recorded rays of a packet of slots to the entries `owner`.
inline void scatter_secondary_rays(const PathBatch& b, int slot, Int owner, Mask real,
                                   float* secondary_rays) {
  Float hit_distance = load(b.secondary_rays[3] + slot);
  Mask whole = real & (hit_distance >= 0.0f);
  Int at = owner * splat(SECONDARY_RAY_WORDS);
  scatter(secondary_rays + 3, at, hit_distance, real);
  for (int i = 0; i < SECONDARY_RAY_WORDS && any(whole); i++) {
    if (i != 3) scatter(secondary_rays + i, at, load(b.secondary_rays[i] + slot), whole);
  }
}

// Finish the batch and store the light of every unit.
inline void store_batch(const Frame& f, const PathFrame& p, DirtyBatch& dirty) {
  finish_paths(f, p, dirty.front);
  const PathBatch& b = dirty.front.batch;
  const PathCacheView& cache = *dirty.front.cache;
  int size = dirty.front.slots / LANES / (dirty.packets > 0 ? dirty.packets : 1);
  for (int k = 0, slot = 0; k < dirty.packets; k++) {
    Float part[3], gap = splat(T_INFINITY);
    Int touched = splat(0);
    for (int s = 0; s < size; s++, slot += LANES) {
      Float light[3];
      load_radiance(f, b, slot, light);
      for (int c = 0; c < 3; c++) part[c] = s == 0 ? splat(0.0f) + light[c] : part[c] + light[c];
      gap = min(load(b.gap + slot), gap);
      touched = touched | load(b.touched + slot);
    }
    Int owner = load(b.owner + k * LANES);
    Mask real = ~(owner < splat(0));
    for (int c = 0; c < 3; c++) scatter(cache.light[c], owner, part[c], real);
    for (int i = 0; i < 6 && cache.indirect[0]; i++) {
      scatter(cache.indirect[i], owner, load(b.indirect[i] + slot - LANES), real);
    }
    if (cache.hit_geom && cache.relight_lamps && !cache.trace_all)
      validate_hits(cache, b, slot - LANES, owner);
    if (cache.secondary_rays)
      scatter_secondary_rays(b, slot - LANES, owner, real & (gap >= 0.0f), cache.secondary_rays);
    scatter(cache.valid_until, owner, valid_until(cache, gap), real);
    scatter(reinterpret_cast<float*>(cache.touched), owner, as_float(touched), real);
  }
  dirty.packets = dirty.front.slots = 0;
}

// Add the samples of the pending units to the batch.
inline void trace_pending(const Frame& f, const PathFrame& p, DirtyBatch& dirty) {
  SampleUnits& u = dirty.pending;
  if (u.count == 0) return;
  const PathCacheView& cache = *dirty.front.cache;
  int first = u.unit[0] * cache.size;
  int size = first + cache.size < f.samples ? cache.size : f.samples - first;
  bool full = dirty.front.slots + size * LANES > PathBatch::ROOM;
  // the last unit of a pixel may have fewer samples
  if (full || size * dirty.packets * LANES != dirty.front.slots) store_batch(f, p, dirty);
  Mask active = u.fill();
  Int x = load(u.x), y = load(u.y), unit = load(u.unit);
  Int owner = (y * splat(cache.units) + unit) * splat(cache.columns) + x;
  store(dirty.front.batch.owner + dirty.packets++ * LANES, select(active, owner, splat(-1)));
  for (int s = 0; s < size; s++) {
    start_paths(f, p, dirty.front, x, y, unit * splat(cache.size) + splat(s), nullptr, active);
  }
  dirty.traced += static_cast<long>(u.count) * size;
  u.count = 0;
}

// Mark the row of LANES pixels around this one as changed.
inline void mark_changed(const PathCacheView& cache, int x, int y) {
  int cell = y / PACKET_HEIGHT * (cache.columns / LANES) + x / LANES;
  cache.changed[cell] = static_cast<uint8_t>(cache.changed[cell] | 1u << y % PACKET_HEIGHT);
}

// Queue one more dirty unit.
inline void add_dirty(const Frame& f, const PathFrame& p, DirtyBatch& dirty, int x, int y,
                      int unit) {
  mark_changed(*dirty.front.cache, x, y);
  dirty.pending.add(x, y, unit);
  if (dirty.pending.count == LANES) trace_pending(f, p, dirty);
}

// Prefetch what sum_units reads: the hardware prefetcher cannot follow as many arrays at once.
inline void prefetch_light(const PathCacheView& cache, int x, int y) {
  for (int u = 0; u < cache.units; u++) {
    long at = (static_cast<long>(y) * cache.units + u) * cache.columns + x;
    for (const float* light : cache.light) {
      for (int i = 0; i < LANES; i += 16) __builtin_prefetch(light + at + i);
    }
  }
}

// Sum the units of adjacent pixels, in the order of trace_packets.
inline void sum_units(const Frame& f, const PathCacheView& cache, int x, int y,
                      const Outputs& out) {
  Float mean[3];
  for (int c = 0; c < 3; c++) {
    Float sum = splat(0.0f), part = sum;
    for (int u = 0; u < cache.units; u++) {
      long at = (static_cast<long>(y) * cache.units + u) * cache.columns + x;
      part = cache.size == 1 ? part + load(cache.light[c] + at) : load(cache.light[c] + at);
      if (cache.size > 1 || u % SUM_BLOCK == SUM_BLOCK - 1 || u == cache.units - 1) {
        sum = sum + part;
        part = splat(0.0f);
      }
    }
    mean[c] = sum * (1.0f / static_cast<float>(f.samples));
  }
  long at = static_cast<long>(y) * f.width + x;
  if (!f.vignette && !out.rgb && x + LANES <= f.width) {
    store(out.luminance + at, luminance_of<3>(f, mean));
    return;
  }
  alignas(64) float grey[LANES], colour[3][LANES];
  store(grey, luminance_of<3>(f, mean));
  for (int c = 0; c < 3; c++) store(colour[c], mean[c]);
  int end = f.width - x < LANES ? f.width - x : LANES;
  for (int i = 0; i < end; i++) {
    out.luminance[at + i] = vignetted(f, at + i, grey[i]);
    for (int c = 0; c < 3 && out.rgb; c++) {
      out.rgb[3 * (at + i) + c] = vignetted(f, at + i, colour[c][i]);
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
