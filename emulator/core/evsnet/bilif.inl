// BiLIF of 16 pixels: V' = d V + I; S = +1 if V' >= V_on, -1 if V' <= -V_off; V = V' - S V_S.
//
// A pixel is active if I is not 0 or V is at a threshold; only then does anything happen to it, and
// V decays at once over all ticks since it was last told. No NaN stays: as I it counts as 0 and as
// clamped, as V it becomes -64.
//
// Included by kernel.inl inside a namespace of its own.

EVS_INLINE Mask over(Float v, const Membrane& m) { return (v >= m.on) | (v <= -m.off); }

// V after `gap` ticks, of lanes that are active.
EVS_INLINE Float decayed(Float v, Int gap, Mask active, const Membrane& m) {
  // nearly always a tick
  if (!any(active & ~(gap == splat(1)))) return v * m.low[1];
  const Mask far = ~(gap < splat(kDecayLow * kDecayHigh));
  const Int known = select(far | (gap < splat(0)), splat(0), gap);
  const Float low = gather(m.low, known & splat(kDecayLow - 1));
  const Float high = gather(m.high, shift_right<8>(known));
  return select(far, splat(0.0f), v * low * high);
}

void fire(TileJob& job) {
  constexpr int64_t kFar = kDecayLow * kDecayHigh;
  const Membrane& m = *job.membrane;
  job.fired = 0;
  job.v_clamped = 0;
  const Mask lanes = mask_of(job.place.lanes());
  alignas(64) float v_lanes[LANES];
  alignas(64) int told_lanes[LANES];
  int64_t last[LANES];
  load_tile(v_lanes, job.v, job.place);
  load_tile(last, job.last, job.place);
  for (int i = 0; i < LANES; i++) {
    // relative to the first tick; what is longer ago has decayed anyway
    const int64_t relative = last[i] < job.tick - kFar ? -kFar : last[i] - job.tick;
    told_lanes[i] = static_cast<int>(relative > 0 ? 0 : relative);
  }
  Float v = load(v_lanes);
  Int told = load(told_lanes);

  for (int t = 0; t < job.ticks; t++) {
    const Float current = load(job.current + t * LANES);
    // a NaN is on neither side
    const Mask still = (current <= 0.0f) & (current >= 0.0f);
    const Mask active = (~still | over(v, m)) & lanes;
    if (!any(active)) continue;
    const Mask known = (current <= 0.0f) | (current >= 0.0f);
    const Float before = decayed(v, splat(t) - told, active, m);
    const Float free = before + select(known, current, splat(0.0f));
    const Float after = min(max(free, splat(-kLargestV)), splat(kLargestV));
    job.v_clamped += __builtin_popcount(bits(active & (~known | (abs(free) > kLargestV))));
    const Mask on = active & (after >= m.on);
    const Mask off = active & (after <= -m.off);
    const Float left = select(on, after - m.on, select(off, after + m.off, after));
    v = select(active, left, v);
    told = select(active, splat(t), told);
    const unsigned fired_on = bits(on), fired_off = bits(off);
    if ((fired_on | fired_off) == 0) continue;
    job.fired |= 1u << t;
    job.on[t] = static_cast<uint16_t>(fired_on);
    job.off[t] = static_cast<uint16_t>(fired_off);
    store(job.before + t * LANES, before);
  }
  job.loud = any(over(v, m) & lanes);

  store(v_lanes, v);
  store(told_lanes, told);
  for (int i = 0; i < LANES; i++) {
    if (told_lanes[i] >= 0) last[i] = job.tick + told_lanes[i];
  }
  store_tile(v_lanes, job.v, job.place);
  store_tile(last, job.last, job.place);
}
