// Light to X_k = L_log(k) - L_log(k-1), tile by tile; as to_log_light of sensor/pixel_front_end.h.
//
// Included by kernel.inl inside a namespace of its own.

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
  alignas(64) float now[kChunk * LANES], dn[kChunk * LANES], part[kChunk * LANES];
  alignas(64) float light[LANES], log[LANES];
  alignas(64) int last[LANES];
  load_tile(light, front.last_luminance, place);
  load_tile(log, front.last_log, place);
  const LogMap map = front.map;

  // logarithms of all ticks side by side: one after another they would wait for each other
  int count = 0;
  for (uint32_t left = flags; left != 0; left &= left - 1) {
    const size_t t = static_cast<size_t>(__builtin_ctz(left));
    load_tile(now + LANES * count++, front.luminance + t * front.frame, place);
  }
  for (int at = 0; at < count * LANES; at += LANES) {
    for (int i = at; i < at + LANES; i++) dn[i] = to_dn(map, now[i]);
    for (int i = at; i < at + LANES; i++) part[i] = log_part<LogKind::linlog>(map, dn[i]);
  }

  const Mask inside = mask_of(place.lanes());
  Float last_light = load(light), last_log = load(log);
  Int last_moved = splat(-1);
  uint32_t ticks = 0;
  int at = 0;
  for (int t = 0; t < front.ticks; t++) {
    float* out = x + t * LANES;
    if ((flags >> t & 1u) == 0) {
      store(out, splat(0.0f));
      continue;
    }
    // as is_light and with_log_part
    const Float seen = load(now + at), seen_dn = load(dn + at);
    const Mask usable = (seen > -kBlack) & (seen_dn <= kLargest);
    const Float below = min(seen_dn * splat(map.slope), splat(map.ln_knee));
    const Float seen_log = select(seen_dn >= map.knee, load(part + at), below);
    const Float new_log = select(usable, seen_log, last_log);
    // the first light only sets L_log
    const Mask known = (last_log <= 0.0f) | (last_log >= 0.0f);
    const Float value = select(known & inside, new_log - last_log, splat(0.0f));
    const Float clamped = min(max(value, splat(-kLargestX)), splat(kLargestX));
    const Mask moved = ~((clamped <= 0.0f) & (clamped >= 0.0f));
    const Mask kept = (clamped <= value) & (value <= clamped);
    store(out, clamped);
    last_log = new_log;
    last_light = select(usable, seen, last_light);
    last_moved = select(moved, splat(t), last_moved);
    ticks |= (any(moved) ? 1u : 0u) << t;
    counts.x_clamped += __builtin_popcount(bits(~kept));
    counts.clamped += __builtin_popcount(bits(~usable & inside));
    at += LANES;
  }
  store(light, last_light);
  store(log, last_log);
  store(last, last_moved);
  store_tile(light, front.last_luminance, place);
  store_tile(log, front.last_log, place);
  for (int i = 0; i < LANES; i++) {
    if (last[i] >= 0) moved[i] = front.tick + last[i];
  }
  return ticks;
}
