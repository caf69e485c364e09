// Paths with a camera that stands: sample by sample, those that something that moved may change.
#pragma once

#include "incremental/cached_hits.inl"
#include "integrators/wavefront.inl"

namespace evs::EVS_SPACE {
namespace {

// Some units, up to a packet of them.
struct Units {
  int count = 0;
  alignas(64) int x[LANES] = {}, y[LANES] = {}, unit[LANES] = {};

  void add(int column, int row, int index) {
    x[count] = column;
    y[count] = row;
    unit[count++] = index;
  }
  // The lanes that there are; the others repeat the last.
  Mask fill() {
    for (int i = count; i < LANES; i++) {
      x[i] = x[count - 1];
      y[i] = y[count - 1];
      unit[i] = unit[count - 1];
    }
    return mask_of(first_lanes(count));
  }
};

// Units that are due: those that wait for their packet to be full, and those of the batch; and
// those that may be.
struct Due {
  Wavefront front;
  int packets = 0;
  long traced = 0;  // samples
  Units waiting = {}, doubtful = {};
};

EVS_INLINE Float until_of(const KeptLight& kept, Float gap) {
  return (gap + kept.travelled) * 0.999999f;
}

// All bits of `lanes`.
inline unsigned any_bits(Int a, unsigned lanes) {
  alignas(64) int each[LANES];
  store(each, a);
  unsigned all = 0;
  for (; lanes; lanes &= lanes - 1) all |= static_cast<unsigned>(each[first_lane(lanes)]);
  return all;
}

// The rays of a packet of slots, to where those of `owner` are kept.
inline void scatter_fans(const PathBatch& b, int slot, Int owner, Mask real, float* fans) {
  Float away = load(b.fans[3] + slot);
  Mask whole = real & (away >= 0.0f);
  Int at = owner * splat(FAN_WORDS);
  store_at(fans + 3, at, away, real);
  for (int i = 0; i < FAN_WORDS && any(whole); i++) {
    if (i != 3) store_at(fans + i, at, load(b.fans[i] + slot), whole);
  }
}

// The light of every unit of the batch, to where it is kept.
inline void keep_batch(const Frame& f, const PathFrame& p, Due& due) {
  finish_paths(f, p, due.front);
  const PathBatch& b = due.front.batch;
  const KeptLight& kept = *due.front.kept;
  int size = due.front.slots / LANES / (due.packets > 0 ? due.packets : 1);
  for (int k = 0, slot = 0; k < due.packets; k++) {
    Float part[3], gap = splat(FAR);
    Int touched = splat(0);
    for (int s = 0; s < size; s++, slot += LANES) {
      Float light[3];
      take_light(f, b, slot, light);
      for (int c = 0; c < 3; c++) part[c] = s == 0 ? splat(0.0f) + light[c] : part[c] + light[c];
      gap = min(load(b.gap + slot), gap);
      touched = touched | load(b.touched + slot);
    }
    Int owner = load(b.owner + k * LANES);
    Mask real = ~(owner < splat(0));
    for (int c = 0; c < 3; c++) store_at(kept.light[c], owner, part[c], real);
    for (int i = 0; i < 6 && kept.rest[0]; i++) {
      store_at(kept.rest[i], owner, load(b.rest[i] + slot - LANES), real);
    }
    if (kept.seen && kept.relit && !kept.all) check_points(kept, b, slot - LANES, owner);
    if (kept.fans) scatter_fans(b, slot - LANES, owner, real & (gap >= 0.0f), kept.fans);
    store_at(kept.until, owner, until_of(kept, gap), real);
    store_at(reinterpret_cast<float*>(kept.touched), owner, as_float(touched), real);
  }
  due.packets = due.front.slots = 0;
}

// The samples of the units that wait join the batch.
inline void trace_due(const Frame& f, const PathFrame& p, Due& due) {
  Units& u = due.waiting;
  if (u.count == 0) return;
  const KeptLight& kept = *due.front.kept;
  int first = u.unit[0] * kept.size;
  int size = first + kept.size < f.samples ? kept.size : f.samples - first;
  bool full = due.front.slots + size * LANES > PathBatch::ROOM;
  // units of a pixel's last samples may be shorter
  if (full || size * due.packets * LANES != due.front.slots) keep_batch(f, p, due);
  Mask active = u.fill();
  Int x = load(u.x), y = load(u.y), unit = load(u.unit);
  Int owner = (y * splat(kept.units) + unit) * splat(kept.columns) + x;
  store(due.front.batch.owner + due.packets++ * LANES, select(active, owner, splat(-1)));
  for (int s = 0; s < size; s++) {
    start_paths(f, p, due.front, x, y, unit * splat(kept.size) + splat(s), nullptr, active);
  }
  due.traced += static_cast<long>(u.count) * size;
  u.count = 0;
}

// The row of LANES pixels around this one changes.
inline void change(const KeptLight& kept, int x, int y) {
  int cell = y / PACKET_HEIGHT * (kept.columns / LANES) + x / LANES;
  kept.changed[cell] = static_cast<uint8_t>(kept.changed[cell] | 1u << y % PACKET_HEIGHT);
}

// One more unit is to be traced.
inline void join(const Frame& f, const PathFrame& p, Due& due, int x, int y, int unit) {
  change(*due.front.kept, x, y);
  due.waiting.add(x, y, unit);
  if (due.waiting.count == LANES) trace_due(f, p, due);
}

// Brings what add_units will read near: as many arrays at once are too many for the processor to
// foresee.
inline void bring_units_near(const KeptLight& kept, int x, int y) {
  for (int u = 0; u < kept.units; u++) {
    long at = (static_cast<long>(y) * kept.units + u) * kept.columns + x;
    for (const float* light : kept.light) {
      for (int i = 0; i < LANES; i += 16) __builtin_prefetch(light + at + i);
    }
  }
}

// The light of pixels side by side, from all their units, as trace_paths adds it up.
inline void add_units(const Frame& f, const KeptLight& kept, int x, int y, const Outputs& out) {
  Float mean[3];
  for (int c = 0; c < 3; c++) {
    Float sum = splat(0.0f), part = sum;
    for (int u = 0; u < kept.units; u++) {
      long at = (static_cast<long>(y) * kept.units + u) * kept.columns + x;
      part = kept.size == 1 ? part + load(kept.light[c] + at) : load(kept.light[c] + at);
      if (kept.size > 1 || u % SUM_BLOCK == SUM_BLOCK - 1 || u == kept.units - 1) {
        sum = sum + part;
        part = splat(0.0f);
      }
    }
    mean[c] = sum * (1.0f / static_cast<float>(f.samples));
  }
  long at = static_cast<long>(y) * f.width + x;
  if (!f.share && !out.rgb && x + LANES <= f.width) {
    store(out.luminance + at, luminance_of<3>(f, mean));
    return;
  }
  alignas(64) float grey[LANES], colour[3][LANES];
  store(grey, luminance_of<3>(f, mean));
  for (int c = 0; c < 3; c++) store(colour[c], mean[c]);
  int end = f.width - x < LANES ? f.width - x : LANES;
  for (int i = 0; i < end; i++) {
    out.luminance[at + i] = shaded(f, at + i, grey[i]);
    for (int c = 0; c < 3 && out.rgb; c++) {
      out.rgb[3 * (at + i) + c] = shaded(f, at + i, colour[c][i]);
    }
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
