// 16 pixels through all layers: X to current, their FIFOs read and written once a chunk.
//
// Look-ahead needs no code of its own but the delay of the residual sum: in a stream, a convolution
// that looks ahead is the same sum, told later.
//
// Included by kernel.inl inside a namespace of its own.

// Floats [first, first + count) of what the pixels remember, into scratch memory or out of it.
template <class Move>
EVS_INLINE void each_block(int first, int count, const Move& move) {
  if (count < LANES) return move(first, count);
  for (int at = 0; at < count; at += LANES) {
    move(first + (at + LANES <= count ? at : count - LANES), LANES);  // the last may overlap
  }
}

EVS_INLINE void recall(const PixelJob& job) {
  each_block(0, job.net->pixel_floats(), [&](int at, int count) {
    turn([&](int i) { return job.row[i] + at; },
         [&](int k) { return job.scratch + job.old_places[at + k]; }, LANES, count);
  });
}

// The last ticks of a stretch of `ticks` are the old ones of the next.
EVS_INLINE void slide(const PixelJob& job, int ticks) {
  const int features = job.net->features();
  for (int f = 0; f < features; f++) {
    float* slots = job.scratch + static_cast<size_t>(f) * FEATURE;
    for (int j = 0; j < kOld; j++) store(slots + j * SLOT, load(slots + (ticks + j) * SLOT));
  }
}

// The last ticks back into memory; the last stretch had `ticks`.
EVS_INLINE void remember(const PixelJob& job, int ticks) {
  const float* scratch = job.scratch + ticks * SLOT;
  auto write = [&](int at, int count) {
    turn([&](int k) { return scratch + job.new_places[at + k]; },
         [&](int i) { return job.row[i] + at; }, count, LANES);
  };
  const int features = job.net->features();
  if (job.ticks >= kOld) return each_block(0, kOld * features, write);
  for (int t = 0; t < job.ticks; t++) {
    each_block(static_cast<int>((job.tick + t) % kOld) * features, features, write);
  }
}

// Ticks [from, from + ticks) of the chunk.
EVS_INLINE void stretch(const PixelJob& job, int from, int ticks, Fetching& fetching) {
  const Net& net = *job.net;
  const int channels = net.channels;
  auto inputs_of = [&](int k) {
    return job.scratch + static_cast<size_t>(net.first_feature(k)) * FEATURE;
  };
  if (from > 0) slide(job, kStretch);
  for (int t = 0; t < ticks; t++) {
    float* x = job.scratch + (kOld + t) * SLOT;
    for (int i = 0; i < LANES; i++) x[i] = job.x[i][(from + t) * LANES];
  }
  const float* weights = net.weights;
  const float* biases = net.biases;
  convolve({weights, biases, channels, 1, inputs_of(0), inputs_of(1), nullptr, ticks}, fetching);
  weights += channels * kTaps;
  biases += channels;
  const int line = channels * channels * kTaps;
  for (int b = 0; b < net.blocks; b++) {
    const int k = 1 + 2 * b;
    convolve({weights, biases, channels, channels, inputs_of(k), inputs_of(k + 1), nullptr, ticks},
             fetching);
    const float* held = inputs_of(k) + (kOld - net.delays[b]) * SLOT;
    convolve({weights + line, biases + channels, channels, channels, inputs_of(k + 1),
              inputs_of(k + 2), held, ticks},
             fetching);
    weights += 2 * line;
    biases += 2 * channels;
  }

  const float* top = inputs_of(net.convolutions()) + kOld * SLOT;
  alignas(64) float current[kStretch * LANES];
  for (int at = 0; at < ticks * LANES; at += WIDE) {
    Wide sum = wide(net.last_bias);
    for (int c = 0; c < channels; c++) {
      sum = wide_fma(wide(net.last[c]), wide_load(top + c * FEATURE + at), sum);
    }
    wide_store(current + at, sum);
  }
  for (int i = 0; i < LANES; i++) {
    for (int t = 0; t < ticks; t++) job.current[i][(from + t) * LANES] = current[t * LANES + i];
  }
}

void infer(const PixelJob& job) {
  recall(job);
  Fetching fetching{job};
  int from = 0;
  for (; from + kStretch < job.ticks; from += kStretch) stretch(job, from, kStretch, fetching);
  stretch(job, from, job.ticks - from, fetching);
  fetching.rest();
  remember(job, job.ticks - from);
}
