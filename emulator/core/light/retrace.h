// Paths with a camera that stands: sample by sample, those that something that moved may change.

// Up to 16 pixels whose unit `unit` is due.
struct Due {
  alignas(64) int x[LANES], y[LANES];
  int count = 0;
};

// Trace them, and keep what comes of it. Out: samples traced.
inline long trace_due(const Frame& f, const PathFrame& p, const KeptLight& kept, int unit,
                      Due& due) {
  int first = unit * kept.size;
  int end = first + kept.size < f.samples ? first + kept.size : f.samples;
  for (int i = due.count; i < LANES; i++) {
    due.x[i] = due.x[due.count - 1];
    due.y[i] = due.y[due.count - 1];
  }
  Int column = load(due.x), row = load(due.y);
  Sampler sampler = {row * splat(f.width) + column, p.sample_set, p.seed, 0, p.digits};
  Clearance clearance = {kept.rods, kept.rod_count, splat(FAR), splat(0)};
  Float part[3];
  for (int s = first; s < end; s++) {
    sampler.index = s;
    Float light[3];
    trace_sample(f, p, sampler, column, row, nullptr, mask_of((1u << due.count) - 1), &clearance,
                 light);
    for (int c = 0; c < 3; c++) part[c] = s == first ? splat(0.0f) + light[c] : part[c] + light[c];
  }
  alignas(64) float light[3][LANES], until[LANES];
  alignas(64) int touched[LANES];
  for (int c = 0; c < 3; c++) store(light[c], part[c]);
  store(until, (clearance.gap + kept.travelled) * 0.999999f);
  store(touched, clearance.touched);
  for (int i = 0; i < due.count; i++) {
    long at = (static_cast<long>(due.y[i]) * kept.units + unit) * kept.columns + due.x[i];
    for (int c = 0; c < 3; c++) kept.light[c][at] = light[c][i];
    kept.until[at] = until[i];
    kept.touched[at] = static_cast<uint32_t>(touched[i]);
  }
  long traced = static_cast<long>(due.count) * (end - first);
  due.count = 0;
  return traced;
}

// Which of 16 units side by side are due, one bit each.
inline unsigned due_units(const KeptLight& kept, long at, unsigned inside) {
  if (kept.all) return inside;
  Mask late = load(kept.until + at) <= kept.travelled;
  Int touched = load(reinterpret_cast<const int*>(kept.touched) + at);
  Mask still = (touched & splat(static_cast<int>(kept.moved))) == splat(0);
  return bits(late | ~still) & inside;
}

// The light of 16 pixels side by side, from all their units, as trace_paths adds it up.
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

long retrace_paths(const Frame& f, const PathFrame& p, const KeptLight& kept, int row,
                   const Outputs& out) {
  int top = row * PACKET_HEIGHT;
  int rows = f.height - top < PACKET_HEIGHT ? f.height - top : PACKET_HEIGHT;
  int groups = kept.columns / LANES;
  uint8_t* changed = kept.changed + static_cast<long>(row) * groups;
  for (int g = 0; g < groups; g++) changed[g] = 0;
  long traced = 0;
  Due due;
  for (int unit = 0; unit < kept.units; unit++) {
    for (int g = 0; g < groups; g++) {
      int left = g * LANES;
      unsigned inside = f.width - left < LANES ? (1u << (f.width - left)) - 1 : 0xffffu;
      unsigned wanted[PACKET_HEIGHT], any_wanted = 0;
      for (int j = 0; j < rows; j++) {
        long at = (static_cast<long>(top + j) * kept.units + unit) * kept.columns + left;
        wanted[j] = due_units(kept, at, inside);
        any_wanted |= wanted[j];
        if (wanted[j]) changed[g] = static_cast<uint8_t>(changed[g] | (1u << j));
      }
      if (!any_wanted) continue;
      // packet by packet: their rays lie close together
      for (int k = 0; k < LANES; k += PACKET_WIDTH) {
        for (int j = 0; j < rows; j++) {
          for (unsigned four = wanted[j] >> k & 15u; four; four &= four - 1) {
            due.x[due.count] = left + k + first_lane(four);
            due.y[due.count++] = top + j;
            if (due.count == LANES) traced += trace_due(f, p, kept, unit, due);
          }
        }
      }
    }
    if (due.count) traced += trace_due(f, p, kept, unit, due);
  }
  for (int g = 0; g < groups; g++) {
    for (int j = 0; j < rows; j++) {
      if (changed[g] >> j & 1) add_units(f, kept, g * LANES, top + j, out);
    }
  }
  return traced;
}
