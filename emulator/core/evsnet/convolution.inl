// The convolutions of 16 pixels over a segment of ticks, in registers.
//
// Order of every sum, for all instruction sets, chunks and register blocks: start from the bias,
// add the inputs one after another, each from its oldest tap on, with one std::fma a term. So an
// output does not depend on what is computed beside it.
#pragma once

#include "evsnet/network_kernel.h"
#include "evsnet/wide.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int SLOT = kLanes;
constexpr int FEATURE = kSlots * kLanes;

// Prefetches the FIFOs of the next pixels line by line while the current ones are computed. All at
// once, the loads would wait for each other.
struct Prefetcher {
  const InferenceJob& job;
  int pixel = 0;
  int at = 0;

  EVS_INLINE void lines(int count) {
    const int floats = job.network->fifo_floats();
    for (int i = 0; i < count && pixel < kLanes; i++) {
      __builtin_prefetch(job.next_fifo[pixel] + at, 1, 2);
      at += SLOT;
      if (at >= floats) at = 0, pixel++;
    }
  }
  EVS_INLINE void rest() { lines(kLanes * job.network->fifo_floats()); }
};

struct Convolution {
  const float* weights;  // (out, in, 7)
  const float* biases;   // (out,)
  int outputs;
  int inputs;
  const float* in;        // [in][22][16]; tap 0 of the first tick is in slot 0
  float* out;             // [out][22][16], from slot 6 on
  const float* residual;  // [out][22][16] from the slot of the first tick on; null: none
  int ticks;
};

// One register block: N outputs from `o` on, T ticks from `t` on, a register of lanes. INPUTS:
// their number where the compiler knows it, else 0.
template <int INPUTS, int N, int T>
EVS_INLINE void convolve_block(const Convolution& c, int o, int t, int lane) {
  const int inputs = INPUTS > 0 ? INPUTS : c.inputs;
  const int line = inputs * kTaps;
  const float* weights = c.weights + o * line;
  const float* in = c.in + t * SLOT + lane;
  // start from the bias
  Wide sum[N][T];
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) sum[n][k] = wide(c.biases[o + n]);
  }
  // add the taps of each input
  for (int i = 0; i < inputs; i++) {
#pragma GCC unroll 8
    for (int j = 0; j < kTaps; j++) {
      Wide x[T];
#pragma GCC unroll 8
      for (int k = 0; k < T; k++) x[k] = wide_load(in + (j + k) * SLOT);
#pragma GCC unroll 8
      for (int n = 0; n < N; n++) {
        const Wide weight = wide(weights[n * line + j]);
#pragma GCC unroll 8
        for (int k = 0; k < T; k++) sum[n][k] = wide_fma(weight, x[k], sum[n][k]);
      }
    }
    weights += kTaps;
    in += FEATURE;
  }
  // add the residual, rectify, store
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
    float* out = c.out + (o + n) * FEATURE + (kFifoTicks + t) * SLOT + lane;
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) {
      Wide value = sum[n][k];
      if (c.residual != nullptr) {
        value = wide_load(c.residual + (o + n) * FEATURE + (t + k) * SLOT + lane) + value;
      }
      wide_store(out + k * SLOT, wide_relu(value));
    }
  }
}

// The same in all lanes.
template <int INPUTS, int N, int T>
EVS_INLINE void convolve_lanes(const Convolution& c, int o, int t, Prefetcher& prefetcher) {
  prefetcher.lines(16);
  for (int lane = 0; lane < kLanes; lane += WIDE) convolve_block<INPUTS, N, T>(c, o, t, lane);
}

// N outputs in all ticks of the segment.
template <int INPUTS, int N>
EVS_INLINE void convolve_outputs(const Convolution& c, int o, Prefetcher& prefetcher) {
  int t = 0;
  for (; t + TICKS <= c.ticks; t += TICKS) convolve_lanes<INPUTS, N, TICKS>(c, o, t, prefetcher);
  for (; t < c.ticks; t++) convolve_lanes<INPUTS, N, 1>(c, o, t, prefetcher);
}

template <int INPUTS>
[[gnu::noinline]] void convolve(const Convolution& c, Prefetcher& prefetcher) {
  int o = 0;
  if (c.ticks < TICKS) {
    for (; o + OUTPUTS_ALONE <= c.outputs; o += OUTPUTS_ALONE) {
      for (int t = 0; t < c.ticks; t++)
        convolve_lanes<INPUTS, OUTPUTS_ALONE, 1>(c, o, t, prefetcher);
    }
  }
  for (; o + OUTPUTS <= c.outputs; o += OUTPUTS)
    convolve_outputs<INPUTS, OUTPUTS>(c, o, prefetcher);
  for (; o < c.outputs; o++) convolve_outputs<INPUTS, 1>(c, o, prefetcher);
}

// Choose the loop with a known number of inputs: 1 is the encoder, 4 and 8 the common channel
// counts.
EVS_INLINE void convolve(const Convolution& c, Prefetcher& prefetcher) {
  if (c.inputs == 1) return convolve<1>(c, prefetcher);
  if (c.inputs == 4) return convolve<4>(c, prefetcher);
  if (c.inputs == 8) return convolve<8>(c, prefetcher);
  convolve<0>(c, prefetcher);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
