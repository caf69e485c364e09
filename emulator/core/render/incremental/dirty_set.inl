// Which samples are due where the camera stands, and what a tick does with rows of packets.
#pragma once

#include "incremental/cached_hits.inl"
#include "incremental/retrace_batch.inl"

namespace evs::EVS_SPACE {
namespace {

// Those whose gap is used up: whose rays are all still clear of what moves get a new one, the
// others join those that are traced.
inline void ask_doubtful(const Frame& f, const PathFrame& p, Due& due) {
  Units& u = due.doubtful;
  if (u.count == 0) return;
  const KeptLight& kept = *due.front.kept;
  Mask active = u.fill();
  Int at = (load(u.y) * splat(kept.units) + load(u.unit)) * splat(kept.columns) + load(u.x);
  Int fan = at * splat(FAN_WORDS);
  auto word = [&](int i) { return gather(kept.fans + i, fan); };
  auto vector = [&](int i) { return Vec{word(i), word(i + 1), word(i + 2)}; };
  Float limit = word(3);
  Mask known = active & (limit >= 0.0f);
  Clearance c = {&kept, splat(kept.reach), splat(0), nullptr};
  Walk w;
  Vec direction = set_out(f, p, load(u.x), load(u.y), load(u.unit), active, w);
  note(c, w.rays.origin, direction, limit, known);
  Vec point = vector(0);
  for (int i = 4; i < FAN_WORDS; i += 4) {
    limit = word(i + 3);
    Mask open = known & (limit > 0.0f), barred = known & (limit < 0.0f);
    if (!any(open | barred)) continue;
    direction = vector(i);
    note(c, point, direction, limit, open);
    note_barred(c, point, direction, -limit, barred);
  }
  // a rod that none of them met before is in the way of one
  Int before = as_int(gather(reinterpret_cast<const float*>(kept.touched), at));
  Mask clear = known & (c.gap >= 0.0f) & ((c.touched | before) == before);
  store_at(kept.until, at, until_of(kept, c.gap), clear);
  for (unsigned lanes = bits(active & ~clear); lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    join(f, p, due, u.x[i], u.y[i], u.unit[i]);
  }
  u.count = 0;
}

// The rays of one more unit are to be asked; they are brought near until then.
inline void doubt(const Frame& f, const PathFrame& p, Due& due, int x, int y, int unit) {
  const KeptLight& kept = *due.front.kept;
  long at = (static_cast<long>(y) * kept.units + unit) * kept.columns + x;
  if (kept.fans) __builtin_prefetch(kept.fans + at * FAN_WORDS);
  due.doubtful.add(x, y, unit);
  if (due.doubtful.count == LANES) ask_doubtful(f, p, due);
}

// Of a unit of pixels side by side, one bit each: what is traced, and whose gap is used up.
struct Wanted {
  unsigned traced, doubtful;
};

inline Wanted wanted_of(const KeptLight& kept, long at, unsigned inside) {
  long packet = at / LANES;
  kept.soonest[packet] = MET;
  if (kept.all) return {inside, 0};
  Float until = load(kept.until + at);
  Int touched = load(reinterpret_cast<const int*>(kept.touched) + at);
  Mask late = until <= kept.travelled;
  Mask met = ~((touched & splat(static_cast<int>(kept.moved))) == splat(0));
  met = met | (kept.fans ? until < splat(0.5f * MET) : late);
  if (kept.relit) met = met | (load(kept.rest[0] + at) < 0.0f);
  unsigned traced = bits(met) & inside, doubtful = bits(late) & inside & ~traced;
  if (!(traced | doubtful)) {
    kept.soonest[packet] = lowest(select(mask_of(inside), until, splat(FAR)));
    kept.met[packet] = any_bits(touched, inside);
  }
  return {traced, doubtful};
}

// Nothing can reach any unit of the packet yet?
EVS_INLINE bool later(const KeptLight& kept, long packet) {
  return kept.soonest[packet] > kept.travelled && !(kept.met[packet] & kept.moved);
}

EVS_INLINE void bring_gaps_near(const KeptLight& kept, long at) {
  for (int i = 0; i < LANES; i += 16) {
    __builtin_prefetch(kept.until + at + i);
    __builtin_prefetch(kept.touched + at + i);
  }
}

// Asks which units of an image row are due, and lights the others again where lamps move.
inline void ask_units(const Frame& f, const PathFrame& p, const KeptLight& kept, int y) {
  long at = static_cast<long>(y) * kept.units * kept.columns;
  for (int unit = 0; unit < kept.units; unit++) {
    unsigned reached = 0;
    for (int left = 0; left < kept.columns; left += LANES, at += LANES) {
      long packet = at / LANES;
      int nth = left / LANES, rest = kept.columns / LANES - nth;
      if (kept.relit && nth % LANES == 0) {
        reached = reached_packets(f, kept, packet, rest < LANES ? rest : LANES);
      }
      unsigned inside = left < f.width ? first_lanes(f.width - left) : 0;
      kept.due[packet] = kept.doubtful[packet] = 0;
      if (kept.all && kept.seen) kept.seen[packet] = NOT_KEPT;
      if (nth + 2 < kept.columns / LANES && !later(kept, packet + 2)) {
        bring_gaps_near(kept, at + 2 * LANES);
      }
      if (!inside || (later(kept, packet) && !kept.relit && !kept.all)) continue;
      Wanted wanted = wanted_of(kept, at, inside);
      kept.due[packet] = wanted.traced;
      kept.doubtful[packet] = wanted.doubtful;
      unsigned others = kept.relit ? inside & ~wanted.traced : 0;
      if (kept.relit) bring_near(kept, at + 2 * LANES);
      bool lit = reached >> nth % LANES & 1;
      if (others && relight_unit(f, p, kept, left, y, unit, others, lit)) change(kept, left, y);
    }
  }
}

// The units first ... first + count of LANES pixels side by side in each image row of a packet row
// that are due join the others.
inline void join_due(const Frame& f, const PathFrame& p, Due& due, int row, int group, int first,
                     int count) {
  const KeptLight& kept = *due.front.kept;
  int top = row * PACKET_HEIGHT, left = group * LANES, stride = kept.columns / LANES;
  int rows = f.height - top < PACKET_HEIGHT ? f.height - top : PACKET_HEIGHT;
  unsigned traced[MOST_SINGLE][PACKET_HEIGHT], doubtful[MOST_SINGLE][PACKET_HEIGHT];
  unsigned of_unit[MOST_SINGLE], some = 0;
  for (int u = 0; u < count; u++) {
    of_unit[u] = 0;
    for (int j = 0; j < rows; j++) {
      long packet = (static_cast<long>(top + j) * kept.units + first + u) * stride + group;
      traced[u][j] = kept.due[packet];
      doubtful[u][j] = kept.doubtful[packet];
      of_unit[u] |= traced[u][j] | doubtful[u][j];
    }
    some |= of_unit[u];
  }
  // packet by packet, with all samples of a pixel: their rays lie close together
  for (int k = 0; k < LANES; k += PACKET_WIDTH) {
    if (!(some >> k & 15u)) continue;
    for (int u = 0; u < count; u++) {
      if (!(of_unit[u] >> k & 15u)) continue;
      for (int j = 0; j < rows; j++) {
        int x = left + k, y = top + j;
        for (unsigned four = traced[u][j] >> k & 15u; four; four &= four - 1) {
          join(f, p, due, x + first_lane(four), y, first + u);
        }
        for (unsigned four = doubtful[u][j] >> k & 15u; four; four &= four - 1) {
          doubt(f, p, due, x + first_lane(four), y, first + u);
        }
      }
    }
  }
}

inline long retrace_paths(const Frame& f, const PathFrame& p, PathBatch& batch,
                          const KeptLight& kept, int begin, int end, const Outputs& out) {
  int groups = (f.width + LANES - 1) / LANES, stride = kept.columns / LANES;
  for (int i = begin * stride; i < end * stride; i++) kept.changed[i] = 0;
  Due due = {{batch, &kept}};
  int last = end * PACKET_HEIGHT < f.height ? end * PACKET_HEIGHT : f.height;
  for (int y = begin * PACKET_HEIGHT; y < last; y++) ask_units(f, p, kept, y);
  for (int row = begin; row < end; row++) {
    if (kept.size == 1) {
      for (int g = 0; g < groups; g++) join_due(f, p, due, row, g, 0, kept.units);
    }
    for (int unit = 0; unit < kept.units && kept.size > 1; unit++) {
      for (int g = 0; g < groups; g++) join_due(f, p, due, row, g, unit, 1);
      // samples of a block go side by side
      trace_due(f, p, due);
    }
  }
  ask_doubtful(f, p, due);
  trace_due(f, p, due);
  keep_batch(f, p, due);
  for (int y = begin * PACKET_HEIGHT; y < last; y++) {
    auto changed = [&](int g) {
      return kept.changed[y / PACKET_HEIGHT * stride + g] >> y % PACKET_HEIGHT & 1;
    };
    for (int g = 0; g < groups; g++) {
      if (g + 1 < groups && changed(g + 1)) bring_units_near(kept, (g + 1) * LANES, y);
      if (changed(g)) add_units(f, kept, g * LANES, y, out);
    }
  }
  return due.traced;
}

}  // namespace
}  // namespace evs::EVS_SPACE
