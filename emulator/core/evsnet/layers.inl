// 16 pixels through all layers, from X to the current I. Their FIFOs are read and written once a
// chunk.
//
// Look-ahead needs no code but the delay of the residual sum: in a stream, a convolution that looks
// ahead is the same sum, given later.
#pragma once

#include "convolution.inl"
#include "network_kernel.h"
#include "transpose.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Call move(first, count) for blocks of up to 16 of the floats [first, first + count) of the FIFOs.
template <class Move>
EVS_INLINE void for_each_block(int first, int count, const Move& move) {
  if (count < LANES) return move(first, count);
  for (int at = 0; at < count; at += LANES) {
    move(first + (at + LANES <= count ? at : count - LANES), LANES);  // the last one may overlap
  }
}

// Load the FIFOs into scratch memory.
EVS_INLINE void load_fifos(const InferenceJob& job) {
  for_each_block(0, job.network->fifo_floats(), [&](int at, int count) {
    transpose([&](int i) { return job.fifo[i] + at; },
              [&](int k) { return job.scratch + job.load_places[at + k]; }, LANES, count);
  });
}

// Shift the FIFO windows in scratch memory by a segment of `ticks`.
EVS_INLINE void shift_fifos(const InferenceJob& job, int ticks) {
  const int features = job.network->features();
  for (int f = 0; f < features; f++) {
    float* slots = job.scratch + static_cast<size_t>(f) * FEATURE;
    for (int j = 0; j < kFifoTicks; j++) store(slots + j * SLOT, load(slots + (ticks + j) * SLOT));
  }
}

// Store the last ticks of every feature in the FIFOs; the last segment had `ticks`.
EVS_INLINE void store_fifos(const InferenceJob& job, int ticks) {
  const float* scratch = job.scratch + ticks * SLOT;
  auto write = [&](int at, int count) {
    transpose([&](int k) { return scratch + job.store_places[at + k]; },
              [&](int i) { return job.fifo[i] + at; }, count, LANES);
  };
  const int features = job.network->features();
  if (job.ticks >= kFifoTicks) return for_each_block(0, kFifoTicks * features, write);
  for (int t = 0; t < job.ticks; t++) {
    for_each_block(static_cast<int>((job.tick + t) % kFifoTicks) * features, features, write);
  }
}

// Ticks [from, from + ticks) of the chunk through all layers.
EVS_INLINE void infer_segment(const InferenceJob& job, int from, int ticks,
                              Prefetcher& prefetcher) {
  const Network& net = *job.network;
  const int channels = net.channels;
  auto inputs_of = [&](int k) {
    return job.scratch + static_cast<size_t>(net.first_feature(k)) * FEATURE;
  };
  // shift the windows, append X
  if (from > 0) shift_fifos(job, kSegment);
  for (int t = 0; t < ticks; t++) {
    float* x = job.scratch + (kFifoTicks + t) * SLOT;
    for (int i = 0; i < LANES; i++) x[i] = job.x[i][(from + t) * LANES];
  }
  // encoder: h(0) = ReLU[Conv1d(X)]
  const float* weights = net.weights;
  const float* biases = net.biases;
  convolve({weights, biases, channels, 1, inputs_of(0), inputs_of(1), nullptr, ticks}, prefetcher);
  weights += channels * kTaps;
  biases += channels;
  const int line = channels * channels * kTaps;
  // residual blocks: h(i) = ReLU[h(i-1) + Conv1d(ReLU[Conv1d(h(i-1))])]
  for (int b = 0; b < net.blocks; b++) {
    const int k = 1 + 2 * b;
    convolve({weights, biases, channels, channels, inputs_of(k), inputs_of(k + 1), nullptr, ticks},
             prefetcher);
    const float* residual = inputs_of(k) + (kFifoTicks - net.delays[b]) * SLOT;
    convolve({weights + line, biases + channels, channels, channels, inputs_of(k + 1),
              inputs_of(k + 2), residual, ticks},
             prefetcher);
    weights += 2 * line;
    biases += 2 * channels;
  }

  // point-wise convolution: I
  const float* top = inputs_of(net.convolutions()) + kFifoTicks * SLOT;
  alignas(64) float current[kSegment * LANES];
  for (int at = 0; at < ticks * LANES; at += WIDE) {
    Wide sum = wide(net.pointwise_bias);
    for (int c = 0; c < channels; c++) {
      sum = wide_fma(wide(net.pointwise[c]), wide_load(top + c * FEATURE + at), sum);
    }
    wide_store(current + at, sum);
  }
  // write I to each pixel
  for (int i = 0; i < LANES; i++) {
    for (int t = 0; t < ticks; t++) job.current[i][(from + t) * LANES] = current[t * LANES + i];
  }
}

// Kernel: the current of 16 pixels through a chunk.
void infer(const InferenceJob& job) {
  load_fifos(job);
  Prefetcher prefetcher{job};
  int from = 0;
  for (; from + kSegment < job.ticks; from += kSegment)
    infer_segment(job, from, kSegment, prefetcher);
  infer_segment(job, from, job.ticks - from, prefetcher);
  prefetcher.rest();
  store_fifos(job, job.ticks - from);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
