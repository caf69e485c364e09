// Paths with a camera that stands: sample by sample, those that something that moved may change.

// Units that are due: those that wait for their packet to be full, and those of the batch.
struct Due {
  Wavefront front;
  int count = 0, packets = 0;
  long traced = 0;  // samples
  alignas(64) int x[LANES] = {}, y[LANES] = {}, unit[LANES] = {};
};

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
    Float until = (gap + kept.travelled) * 0.999999f;
    Int owner = load(b.owner + k * LANES);
    Mask real = ~(owner < splat(0));
    for (int c = 0; c < 3; c++) store_at(kept.light[c], owner, part[c], real);
    for (int i = 0; i < 6 && kept.rest[0]; i++) {
      store_at(kept.rest[i], owner, load(b.rest[i] + slot - LANES), real);
    }
    if (kept.seen && kept.relit && !kept.all) check_points(kept, b, slot - LANES, owner);
    store_at(kept.until, owner, until, real);
    store_at(reinterpret_cast<float*>(kept.touched), owner, as_float(touched), real);
  }
  due.packets = due.front.slots = 0;
}

// The samples of the units that wait join the batch.
inline void trace_due(const Frame& f, const PathFrame& p, Due& due) {
  if (due.count == 0) return;
  const KeptLight& kept = *due.front.kept;
  int first = due.unit[0] * kept.size;
  int size = first + kept.size < f.samples ? kept.size : f.samples - first;
  bool full = due.front.slots + size * LANES > PathBatch::ROOM;
  // units of a pixel's last samples may be shorter
  if (full || size * due.packets * LANES != due.front.slots) keep_batch(f, p, due);
  int* owner = due.front.batch.owner + due.packets++ * LANES;
  for (int i = 0; i < LANES; i++) {
    owner[i] = -1;
    if (i < due.count) {
      owner[i] = (due.y[i] * kept.units + due.unit[i]) * kept.columns + due.x[i];
      continue;
    }
    due.x[i] = due.x[due.count - 1];
    due.y[i] = due.y[due.count - 1];
    due.unit[i] = due.unit[due.count - 1];
  }
  Mask active = mask_of(first_lanes(due.count));
  Int index = load(due.unit) * splat(kept.size);
  for (int s = 0; s < size; s++) {
    start_paths(f, p, due.front, load(due.x), load(due.y), index + splat(s), nullptr, active);
  }
  due.traced += static_cast<long>(due.count) * size;
  due.count = 0;
}

// Which of the units of pixels side by side are due, one bit each.
inline unsigned due_units(const KeptLight& kept, long at, unsigned inside) {
  if (kept.all) return inside;
  Mask late = load(kept.until + at) <= kept.travelled;
  if (kept.relit) late = late | (load(kept.rest[0] + at) < 0.0f);
  Int touched = load(reinterpret_cast<const int*>(kept.touched) + at);
  Mask still = (touched & splat(static_cast<int>(kept.moved))) == splat(0);
  return bits(late | ~still) & inside;
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
  alignas(64) float grey[LANES], colour[3][LANES];
  store(grey, luminance_of<3>(f, mean));
  for (int c = 0; c < 3; c++) store(colour[c], mean[c]);
  int end = f.width - x < LANES ? f.width - x : LANES;
  long at = static_cast<long>(y) * f.width + x;
  for (int i = 0; i < end; i++) {
    out.luminance[at + i] = shaded(f, at + i, grey[i]);
    for (int c = 0; c < 3 && out.rgb; c++) {
      out.rgb[3 * (at + i) + c] = shaded(f, at + i, colour[c][i]);
    }
  }
}

// Asks which units of a packet row are due, and lights the others again where lamps move.
inline void ask_units(const Frame& f, const PathFrame& p, const KeptLight& kept, int top, int rows,
                      uint8_t* changed) {
  long at = static_cast<long>(top) * kept.units * kept.columns;
  for (int j = 0; j < rows; j++) {
    for (int unit = 0; unit < kept.units; unit++) {
      unsigned reached = 0;
      for (int left = 0; left < kept.columns; left += LANES, at += LANES) {
        int packet = left / LANES, rest = kept.columns / LANES - packet;
        if (kept.relit && packet % LANES == 0) {
          reached = reached_packets(f, kept, at / LANES, rest < LANES ? rest : LANES);
        }
        unsigned inside = left < f.width ? first_lanes(f.width - left) : 0;
        unsigned due = due_units(kept, at, inside), others = kept.relit ? inside & ~due : 0;
        kept.due[at / LANES] = due;
        if (kept.all && kept.seen) kept.seen[at / LANES] = NOT_KEPT;
        if (kept.relit) bring_near(kept, at + 2 * LANES);
        if (!others ||
            !relight_unit(f, p, kept, left, top + j, unit, others, reached >> packet % LANES & 1))
          others = 0;
        if (due | others) changed[packet] |= static_cast<uint8_t>(1u << j);
      }
    }
  }
}

inline long retrace_paths(const Frame& f, const PathFrame& p, PathBatch& batch,
                          const KeptLight& kept, int row, const Outputs& out) {
  int top = row * PACKET_HEIGHT;
  int rows = f.height - top < PACKET_HEIGHT ? f.height - top : PACKET_HEIGHT;
  int groups = (f.width + LANES - 1) / LANES;
  uint8_t* changed = kept.changed + static_cast<long>(row) * groups;
  for (int g = 0; g < groups; g++) changed[g] = 0;
  ask_units(f, p, kept, top, rows, changed);
  Due due = {{batch, &kept}};
  for (int unit = 0; unit < kept.units; unit++) {
    for (int g = 0; g < groups; g++) {
      int left = g * LANES;
      unsigned wanted[PACKET_HEIGHT], any_wanted = 0;
      for (int j = 0; j < rows; j++) {
        long at = (static_cast<long>(top + j) * kept.units + unit) * kept.columns + left;
        wanted[j] = kept.due[at / LANES];
        any_wanted |= wanted[j];
      }
      if (!any_wanted) continue;
      // packet by packet: their rays lie close together
      for (int k = 0; k < LANES; k += PACKET_WIDTH) {
        for (int j = 0; j < rows; j++) {
          for (unsigned four = wanted[j] >> k & 15u; four; four &= four - 1) {
            due.x[due.count] = left + k + first_lane(four);
            due.y[due.count] = top + j;
            due.unit[due.count++] = unit;
            if (due.count == LANES) trace_due(f, p, due);
          }
        }
      }
    }
    // samples of a block go side by side
    if (kept.size > 1) trace_due(f, p, due);
  }
  trace_due(f, p, due);
  keep_batch(f, p, due);
  for (int g = 0; g < groups; g++) {
    for (int j = 0; j < rows; j++) {
      if (changed[g] >> j & 1) add_units(f, kept, g * LANES, top + j, out);
    }
  }
  return due.traced;
}
