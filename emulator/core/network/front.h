// Light to X_k = L_log(k) - L_log(k-1), tile by tile; as to_log_light of sensor/stages.h.
//
// Included by kernel.inc inside a namespace of its own.

EVS_INLINE unsigned flagged(Int now, Int before, Int limit) {
  // a float of the other sign is a negative integer
  return bits(~(now == before) | (now < splat(0)) | ~(now < limit));
}

void look(const Front& front, size_t pixel, size_t width, int rows, uint32_t* flags) {
  const Int limit = splat(static_cast<int>(front.unusable_from));
  const size_t whole = width / LANES * LANES;
  for (int t = 0; t < front.ticks; t++) {
    const float* frame = front.luminance + static_cast<size_t>(t) * front.frame + pixel;
    const float* before = t == 0 ? front.last_luminance + pixel : frame - front.frame;
    const uint32_t bit = 1u << t;
    for (size_t x = 0; x < whole; x += LANES) {
      unsigned changed = 0;
      for (int r = 0; r < rows; r++) {
        const size_t at = static_cast<size_t>(r) * width + x;
        changed |= flagged(as_int(load(frame + at)), as_int(load(before + at)), limit);
      }
      if (changed == 0) continue;
      for (int i = 0; i < LANES / kSide; i++) {
        if ((changed >> (i * kSide) & 0xfu) != 0) flags[x / kSide + static_cast<size_t>(i)] |= bit;
      }
    }
    for (size_t x = whole; x < width; x++) {
      for (int r = 0; r < rows; r++) {
        const size_t at = static_cast<size_t>(r) * width + x;
        uint32_t now, then;
        __builtin_memcpy(&now, frame + at, sizeof now);
        __builtin_memcpy(&then, before + at, sizeof then);
        if (now != then || now >= front.unusable_from) flags[x / kSide] |= bit;
      }
    }
  }
}

// Lanes beyond the image are copies of its edge: what they hold never leaves the kernel.
template <class T>
EVS_INLINE void load_tile(T* lanes, const T* image, const TilePlace& place) {
  const T* from = image + place.pixel;
  if (place.whole()) {
    for (int r = 0; r < kSide; r++) {
      __builtin_memcpy(lanes + kSide * r, from + static_cast<size_t>(r) * place.width,
                       sizeof(T) * kSide);
    }
    return;
  }
  for (int i = 0; i < LANES; i++) {
    const int r = i / kSide < place.rows ? i / kSide : place.rows - 1;
    const int c = i % kSide < place.columns ? i % kSide : place.columns - 1;
    lanes[i] = from[static_cast<size_t>(r) * place.width + static_cast<size_t>(c)];
  }
}

template <class T>
EVS_INLINE void store_tile(const T* lanes, T* image, const TilePlace& place) {
  T* to = image + place.pixel;
  for (int r = 0; r < place.rows; r++) {
    T* line = to + static_cast<size_t>(r) * place.width;
    if (place.columns == kSide) {
      __builtin_memcpy(line, lanes + kSide * r, sizeof(T) * kSide);
    } else {
      for (int c = 0; c < place.columns; c++) line[c] = lanes[kSide * r + c];
    }
  }
}

uint32_t to_x(const Front& front, const TilePlace& place, uint32_t flags, float* x, int64_t* moved,
              FrontCounts& counts) {
  alignas(64) float now[LANES], light[LANES], dn[LANES], part[LANES], log[LANES];
  alignas(64) uint32_t inside[LANES];
  alignas(64) int last[LANES];
  for (int i = 0; i < LANES; i++) inside[i] = place.inside(i) ? 1u : 0u;
  for (int i = 0; i < LANES; i++) last[i] = -1;
  load_tile(light, front.last_luminance, place);
  load_tile(log, front.last_log, place);
  const LogMap map = front.map;

  uint32_t ticks = 0;
  for (int t = 0; t < front.ticks; t++) {
    float* out = x + t * LANES;
    if ((flags >> t & 1u) == 0) {
      for (int i = 0; i < LANES; i++) out[i] = 0.0f;
      continue;
    }
    load_tile(now, front.luminance + static_cast<size_t>(t) * front.frame, place);
    for (int i = 0; i < LANES; i++) dn[i] = to_dn(map, now[i]);
    for (int i = 0; i < LANES; i++) part[i] = log_part<LogKind::linlog>(map, dn[i]);
    uint32_t any = 0, replaced = 0, clipped = 0;
    for (int i = 0; i < LANES; i++) {
      const bool usable = is_light(now[i], dn[i]);
      const float old_log = log[i];
      const float new_log =
          choose(usable, with_log_part<LogKind::linlog>(map, dn[i], part[i]), old_log);
      // the first light only sets L_log
      const float step = new_log - old_log;
      const float value = choose((old_log == old_log) & (inside[i] != 0), step, 0.0f);
      const float low = value > -kLargestX ? value : -kLargestX;
      const float high = low < kLargestX ? low : kLargestX;
      clipped += high != value ? 1u : 0u;
      replaced += (usable ? 0u : 1u) & inside[i];
      any |= high != 0.0f ? 1u : 0u;
      out[i] = high;
      log[i] = new_log;
      light[i] = choose(usable, now[i], light[i]);
    }
    // a loop of its own: the one before would not come out in vectors
    for (int i = 0; i < LANES; i++) last[i] = out[i] != 0.0f ? t : last[i];
    counts.clamped += replaced;
    counts.x_clamped += clipped;
    ticks |= any << t;
  }
  store_tile(light, front.last_luminance, place);
  store_tile(log, front.last_log, place);
  for (int i = 0; i < LANES; i++) {
    if (last[i] >= 0) moved[i] = front.tick + last[i];
  }
  return ticks;
}
