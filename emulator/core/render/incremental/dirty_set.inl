// The dirty set of `path` under a still camera: find the samples to trace again, and update rows of
// packets.
//
//  1. Scan each image row for units that a moving geom may have touched (dirty), or whose gap the
//     motion has used up (expired). Relight the others if lights have changed.
//  2. Test the recorded rays of expired units. A new gap makes the unit valid again; a touched ray
//     makes it dirty.
//  3. Trace the dirty units in full packets, and store light, rays and gaps.
//  4. Sum the units of every pixel that changed.
#pragma once

#include "render/incremental/cached_hits.inl"
#include "render/integrators/wavefront.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Steps 3 and 4: collect units into full packets, trace them, store and sum their light.

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
    // sum the samples of each unit; its gap is the smallest of theirs
    Float part[3], gap = splat(T_INFINITY);
    Int touched = splat(0), geoms = splat(-1);
    for (int s = 0; s < size; s++, slot += LANES) {
      Float light[3];
      load_radiance(f, b, slot, light);
      for (int c = 0; c < 3; c++) part[c] = s == 0 ? splat(0.0f) + light[c] : part[c] + light[c];
      gap = min(load(b.gap + slot), gap);
      touched = touched | load(b.touched + slot);
      if (cache.first_geom) {
        Int geom = load(b.first_geom + slot);
        geoms = s == 0 ? geom : join_geoms(geoms, geom);
      }
    }
    // scatter light, rays and gaps to the units
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
    if (cache.first_geom)
      scatter(reinterpret_cast<float*>(cache.first_geom), owner, as_float(geoms), real);
  }
  dirty.packets = dirty.front.slots = 0;
}

// Add the samples of the pending units to the batch.
inline void trace_pending(const Frame& f, const PathFrame& p, DirtyBatch& dirty) {
  // finish the batch first if the samples do not fit
  SampleUnits& u = dirty.pending;
  if (u.count == 0) return;
  const PathCacheView& cache = *dirty.front.cache;
  int first = u.unit[0] * cache.size;
  int size = first + cache.size < f.samples ? cache.size : f.samples - first;
  bool full = dirty.front.slots + size * LANES > PathBatch::ROOM;
  // the last unit of a pixel may have fewer samples
  if (full || size * dirty.packets * LANES != dirty.front.slots) store_batch(f, p, dirty);
  // start the paths of all samples
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
  // mean over the samples
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
  if (out.geoms) {
    Int geoms = splat(-1);
    for (int u = 0; u < cache.units; u++) {
      Int geom =
          load(cache.first_geom + (static_cast<long>(y) * cache.units + u) * cache.columns + x);
      geoms = u == 0 ? geom : join_geoms(geoms, geom);
    }
    write_geoms(f, x, y, geoms, out.geoms);
  }
  // write whole packets of luminance at once, everything else pixel by pixel
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

// Steps 1 and 2: find the dirty units.

// Recheck expired units: those whose recorded rays are still clear get a new gap, the others become
// dirty.
inline void recheck_expired(const Frame& f, const PathFrame& p, DirtyBatch& dirty) {
  SampleUnits& u = dirty.expired;
  if (u.count == 0) return;
  const PathCacheView& cache = *dirty.front.cache;
  Mask active = u.fill();
  Int at = (load(u.y) * splat(cache.units) + load(u.unit)) * splat(cache.columns) + load(u.x);
  Int secondary = at * splat(SECONDARY_RAY_WORDS);
  auto word = [&](int i) { return gather(cache.secondary_rays + i, secondary); };
  auto vector = [&](int i) { return Vec{word(i), word(i + 1), word(i + 2)}; };
  Float t_max = word(3);
  Mask known = active & (t_max >= 0.0f);
  Clearance c = {&cache, splat(cache.max_gap), splat(0), nullptr};
  // measure the camera rays again
  PathState path;
  Vec direction = generate_camera_rays(f, p, load(u.x), load(u.y), load(u.unit), active, path);
  note_ray(c, path.rays.origin, direction, t_max, known);
  // measure the recorded secondary rays again
  Vec point = vector(0);
  for (int i = 4; i < SECONDARY_RAY_WORDS; i += 4) {
    t_max = word(i + 3);
    Mask open = known & (t_max > 0.0f), occluded_lanes = known & (t_max < 0.0f);
    if (!any(open | occluded_lanes)) continue;
    direction = vector(i);
    note_ray(c, point, direction, t_max, open);
    note_occluded_ray(c, point, direction, -t_max, occluded_lanes);
  }
  // clear: every ray keeps a gap, and touches no capsule that it did not touch before
  Int before = as_int(gather(reinterpret_cast<const float*>(cache.touched), at));
  Mask clear = known & (c.gap >= 0.0f) & ((c.touched | before) == before);
  scatter(cache.valid_until, at, valid_until(cache, c.gap), clear);
  // the others are dirty
  for (unsigned lanes = to_bits(active & ~clear); lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    add_dirty(f, p, dirty, u.x[i], u.y[i], u.unit[i]);
  }
  u.count = 0;
}

// Queue one more expired unit for the recheck, and prefetch its rays.
inline void add_expired(const Frame& f, const PathFrame& p, DirtyBatch& dirty, int x, int y,
                        int unit) {
  const PathCacheView& cache = *dirty.front.cache;
  long at = (static_cast<long>(y) * cache.units + unit) * cache.columns + x;
  if (cache.secondary_rays) __builtin_prefetch(cache.secondary_rays + at * SECONDARY_RAY_WORDS);
  dirty.expired.add(x, y, unit);
  if (dirty.expired.count == LANES) recheck_expired(f, p, dirty);
}

// The state of one unit of adjacent pixels, one bit each: dirty, or expired.
struct UnitState {
  unsigned dirty, expired;
};

// Classify a unit of adjacent pixels from its gap and the geoms that it touched. Lanes of `inside`
// lie in the image.
inline UnitState classify_units(const PathCacheView& cache, long at, unsigned inside) {
  long packet = at / LANES;
  cache.next_expiry[packet] = DIRTY;
  if (cache.trace_all) return {inside, 0};
  Float valid_until = load(cache.valid_until + at);
  Int touched = load(reinterpret_cast<const int*>(cache.touched) + at);
  // expired: the motion has used up the gap; dirty: a geom that it touched has moved
  Mask used_up = valid_until <= cache.motion;
  Mask touched_moving = ~((touched & splat(static_cast<int>(cache.moved))) == splat(0));
  touched_moving =
      touched_moving | (cache.secondary_rays ? valid_until < splat(0.5f * DIRTY) : used_up);
  if (cache.relight_lamps) touched_moving = touched_moving | (load(cache.indirect[0] + at) < 0.0f);
  unsigned retrace = to_bits(touched_moving) & inside,
           expired = to_bits(used_up) & inside & ~retrace;
  // summarise clean packets, so that later ticks skip them as a whole
  if (!(retrace | expired)) {
    cache.next_expiry[packet] =
        reduce_min(select(mask_from_bits(inside), valid_until, splat(T_INFINITY)));
    cache.touched_any[packet] = reduce_or(touched, inside);
  }
  return {retrace, expired};
}

// Can nothing have touched any unit of the packet yet?
EVS_INLINE bool still_valid(const PathCacheView& cache, long packet) {
  return cache.next_expiry[packet] > cache.motion && !(cache.touched_any[packet] & cache.moved);
}

EVS_INLINE void prefetch_gaps(const PathCacheView& cache, long at) {
  for (int i = 0; i < LANES; i += 16) {
    __builtin_prefetch(cache.valid_until + at + i);
    __builtin_prefetch(cache.touched + at + i);
  }
}

// The bits of LANES adjacent pixels in a mask of the image.
EVS_INLINE unsigned pixel_bits(const PathCacheView& cache, const uint32_t* mask, int x, int y) {
  return mask[static_cast<long>(y) * (cache.columns / 32) + x / 32] >> x % 32 & ALL_LANES;
}

// Find the dirty and the expired units of an image row, and relight the others where lights change.
inline void find_dirty_units(const Frame& f, const PathFrame& p, const PathCacheView& cache,
                             int y) {
  long at = static_cast<long>(y) * cache.units * cache.columns;
  for (int unit = 0; unit < cache.units; unit++) {
    unsigned reached = 0;
    for (int first_column = 0; first_column < cache.columns; first_column += LANES, at += LANES) {
      long packet = at / LANES;
      int group = first_column / LANES, groups_left = cache.columns / LANES - group;
      // test LANES packets at once against the lights that change
      if (cache.relight_lamps && group % LANES == 0) {
        reached = lit_packets(f, cache, packet, groups_left < LANES ? groups_left : LANES);
      }
      unsigned inside = first_column < f.width ? first_lanes(f.width - first_column) : 0;
      unsigned added = 0;  // pixels whose units are not known yet
      if (cache.marked) {
        inside &= pixel_bits(cache, cache.marked, first_column, y);
        added = inside & ~pixel_bits(cache, cache.known, first_column, y);
      }
      cache.dirty[packet] = cache.expired[packet] = 0;
      if (cache.trace_all && cache.hit_geom) cache.hit_geom[packet] = NOT_CACHED;
      if (group + 2 < cache.columns / LANES && !still_valid(cache, packet + 2)) {
        prefetch_gaps(cache, at + 2 * LANES);
      }
      if (!inside ||
          (still_valid(cache, packet) && !added && !cache.relight_lamps && !cache.trace_all))
        continue;
      // mark the samples to trace or recheck
      UnitState state = classify_units(cache, at, inside & ~added);
      if (added) cache.next_expiry[packet] = DIRTY;
      state.dirty |= added;
      cache.dirty[packet] = state.dirty;
      cache.expired[packet] = state.expired;
      // relight the others
      unsigned clean = cache.relight_lamps ? inside & ~state.dirty : 0;
      if (cache.relight_lamps) prefetch_unit(cache, at + 2 * LANES);
      bool lit = reached >> group % LANES & 1;
      if (clean && relight_unit(f, p, cache, first_column, y, unit, clean, lit))
        mark_changed(cache, first_column, y);
    }
  }
  for (int i = 0; i < cache.columns / 32 && cache.marked; i++) {
    long word = static_cast<long>(y) * (cache.columns / 32) + i;
    cache.known[word] = cache.marked[word];
  }
}

// Queue the dirty and expired units first ... first + count of LANES adjacent pixels in each image
// row of a packet row.
inline void collect_dirty(const Frame& f, const PathFrame& p, DirtyBatch& dirty, int row, int group,
                          int first, int count) {
  const PathCacheView& cache = *dirty.front.cache;
  // gather the bits of all units
  int top = row * PACKET_HEIGHT, first_column = group * LANES, stride = cache.columns / LANES;
  int rows = f.height - top < PACKET_HEIGHT ? f.height - top : PACKET_HEIGHT;
  unsigned retrace[MAX_SINGLE_UNITS][PACKET_HEIGHT], expired[MAX_SINGLE_UNITS][PACKET_HEIGHT];
  unsigned of_unit[MAX_SINGLE_UNITS], some = 0;
  for (int u = 0; u < count; u++) {
    of_unit[u] = 0;
    for (int j = 0; j < rows; j++) {
      long packet = (static_cast<long>(top + j) * cache.units + first + u) * stride + group;
      retrace[u][j] = cache.dirty[packet];
      expired[u][j] = cache.expired[packet];
      of_unit[u] |= retrace[u][j] | expired[u][j];
    }
    some |= of_unit[u];
  }
  // go packet by packet, through all samples of a pixel, so that the rays are coherent
  for (int k = 0; k < LANES; k += PACKET_WIDTH) {
    if (!(some >> k & 15u)) continue;
    for (int u = 0; u < count; u++) {
      if (!(of_unit[u] >> k & 15u)) continue;
      for (int j = 0; j < rows; j++) {
        int x = first_column + k, y = top + j;
        for (unsigned four = retrace[u][j] >> k & 15u; four; four &= four - 1) {
          add_dirty(f, p, dirty, x + first_lane(four), y, first + u);
        }
        for (unsigned four = expired[u][j] >> k & 15u; four; four &= four - 1) {
          add_expired(f, p, dirty, x + first_lane(four), y, first + u);
        }
      }
    }
  }
}

// Update packet rows begin ... end. Returns the number of samples traced.
inline long update_cached_paths(const Frame& f, const PathFrame& p, PathBatch& batch,
                                const PathCacheView& cache, int begin, int end,
                                const Outputs& out) {
  int groups = (f.width + LANES - 1) / LANES, stride = cache.columns / LANES;
  for (int i = begin * stride; i < end * stride; i++) cache.changed[i] = 0;
  DirtyBatch dirty = {{batch, &cache}};
  dirty.front.geoms = cache.first_geom != nullptr;
  int last = end * PACKET_HEIGHT < f.height ? end * PACKET_HEIGHT : f.height;
  // 1. scan for dirty and expired units
  for (int y = begin * PACKET_HEIGHT; y < last; y++) find_dirty_units(f, p, cache, y);
  // 2, 3. recheck the expired units and trace the dirty ones, in full packets
  for (int row = begin; row < end; row++) {
    if (cache.size == 1) {
      for (int g = 0; g < groups; g++) collect_dirty(f, p, dirty, row, g, 0, cache.units);
    }
    for (int unit = 0; unit < cache.units && cache.size > 1; unit++) {
      for (int g = 0; g < groups; g++) collect_dirty(f, p, dirty, row, g, unit, 1);
      // the samples of a block form packets of their own
      trace_pending(f, p, dirty);
    }
  }
  recheck_expired(f, p, dirty);
  trace_pending(f, p, dirty);
  store_batch(f, p, dirty);
  // 4. sum the pixels that changed
  for (int y = begin * PACKET_HEIGHT; y < last; y++) {
    auto changed = [&](int g) {
      return cache.changed[y / PACKET_HEIGHT * stride + g] >> y % PACKET_HEIGHT & 1;
    };
    for (int g = 0; g < groups; g++) {
      if (g + 1 < groups && changed(g + 1)) prefetch_light(cache, (g + 1) * LANES, y);
      if (changed(g)) sum_units(f, cache, g * LANES, y, out);
    }
  }
  return dirty.traced;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
