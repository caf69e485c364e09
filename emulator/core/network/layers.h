// A tile through all layers: X to current, its FIFOs read and written once a chunk.
//
// Look-ahead needs no code of its own but the delay of the residual sum: in a stream, a convolution
// that looks ahead is the same sum, told later.
//
// Included by kernel.inc inside a namespace of its own.

// The old ticks of features [first, first + count) out of the tile's memory.
EVS_INLINE void recall(const TileJob& job, int first, int count) {
  const int oldest = static_cast<int>(job.tick % kOld);
  for (int f = first; f < first + count; f++) {
    const float* row = job.row + static_cast<size_t>(f) * kOld * SLOT;
    float* slots = job.scratch + static_cast<size_t>(f) * FEATURE;
    for (int j = 0; j < kOld; j++) {
      const int slot = oldest + j < kOld ? oldest + j : oldest + j - kOld;
      store(slots + j * SLOT, load(row + slot * SLOT));
    }
  }
  if (job.next_row == nullptr) return;
  const float* next = job.next_row + static_cast<size_t>(first) * kOld * SLOT;
  for (int line = 0; line < count * kOld; line++) __builtin_prefetch(next + line * SLOT, 1, 2);
}

// The last ticks of a stretch of `ticks` are the old ones of the next.
EVS_INLINE void slide(const TileJob& job, int ticks) {
  const int features = job.net->features();
  for (int f = 0; f < features; f++) {
    float* slots = job.scratch + static_cast<size_t>(f) * FEATURE;
    for (int j = 0; j < kOld; j++) store(slots + j * SLOT, load(slots + (ticks + j) * SLOT));
  }
}

// The last ticks back into the tile's memory; the last stretch had `ticks`.
EVS_INLINE void remember(const TileJob& job, int ticks) {
  const int count = job.ticks < kOld ? job.ticks : kOld;
  const int64_t first = job.tick + job.ticks - count;
  const int features = job.net->features();
  for (int k = 0; k < count; k++) {
    const int slot = static_cast<int>((first + k) % kOld);
    float* row = job.row + slot * SLOT;
    const float* slots = job.scratch + (ticks + kOld - count + k) * SLOT;
    for (int f = 0; f < features; f++) {
      store(row + static_cast<size_t>(f) * kOld * SLOT,
            load(slots + static_cast<size_t>(f) * FEATURE));
    }
  }
}

// Ticks [from, from + ticks) of the chunk.
EVS_INLINE void stretch(TileJob& job, int from, int ticks) {
  const Net& net = *job.net;
  const int channels = net.channels;
  auto inputs_of = [&](int k) {
    return job.scratch + static_cast<size_t>(net.first_feature(k)) * FEATURE;
  };
  // a layer's old ticks are fetched when its turn comes, since memory is what waits longest
  auto old_of = [&](int k) {
    if (from == 0) recall(job, net.first_feature(k), k == 0 ? 1 : channels);
  };
  if (from > 0) slide(job, kStretch);
  old_of(0);
  for (int t = 0; t < ticks; t++) {
    const Float x = job.x == nullptr ? splat(0.0f) : load(job.x + (from + t) * LANES);
    store(job.scratch + (kOld + t) * SLOT, x);
  }
  const float* weights = net.weights;
  const float* biases = net.biases;
  convolve({weights, biases, channels, 1, inputs_of(0), inputs_of(1), nullptr, ticks});
  weights += channels * kTaps;
  biases += channels;
  const int line = channels * channels * kTaps;
  for (int b = 0; b < net.blocks; b++) {
    const int k = 1 + 2 * b;
    old_of(k);
    convolve({weights, biases, channels, channels, inputs_of(k), inputs_of(k + 1), nullptr, ticks});
    old_of(k + 1);
    const float* held = inputs_of(k) + (kOld - net.delays[b]) * SLOT;
    convolve({weights + line, biases + channels, channels, channels, inputs_of(k + 1),
              inputs_of(k + 2), held, ticks});
    weights += 2 * line;
    biases += 2 * channels;
  }

  const float* top = inputs_of(net.convolutions()) + kOld * SLOT;
  float* current = job.current + from * LANES;
  for (int at = 0; at < ticks * LANES; at += WIDE) {
    Wide sum = wide(net.last_bias);
    for (int c = 0; c < channels; c++) {
      sum = wide_fma(wide(net.last[c]), wide_load(top + c * FEATURE + at), sum);
    }
    wide_store(current + at, sum);
  }
}

void run(TileJob& job) {
  job.fired = 0;
  job.v_clamped = 0;
  if (job.row == nullptr) {
    for (int t = 0; t < job.ticks; t++) store(job.current + t * LANES, splat(0.0f));
  } else {
    int from = 0;
    for (; from + kStretch < job.ticks; from += kStretch) stretch(job, from, kStretch);
    stretch(job, from, job.ticks - from);
    remember(job, job.ticks - from);
  }
  if (job.currents != nullptr) {
    for (int t = 0; t < job.ticks; t++) {
      store_tile(job.current + t * LANES, job.currents + static_cast<size_t>(t) * job.frame,
                 job.place);
    }
  }
  fire(job);
}
