// 16 pixels through all layers, from X to the current I. Their FIFOs are read and written once a
// chunk.
//
// Look-ahead needs no code but the delay of the residual sum: in a stream, a convolution that looks
// ahead is the same sum, given later.
#pragma once

#include "evsnet/network_kernel.h"
#include "evsnet/wide_register.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// The convolutions of 16 pixels over a segment of ticks, in registers.
//
// Order of every sum, for all instruction sets, chunks and register blocks: start from the bias,
// add the inputs one after another, each from its oldest tap on, with one std::fma a term. So an
// output does not depend on what is computed beside it.

constexpr int SLOT = TILE_LANES;
constexpr int FEATURE = SLOTS * TILE_LANES;

// Prefetches the FIFOs of the next pixels line by line while the current ones are computed. All at
// once, the loads would wait for each other.
struct Prefetcher {
  const InferenceJob& job;
  int pixel = 0;
  int at = 0;

  EVS_INLINE void lines(int count) {
    const int floats = job.network->fifo_floats();
    for (int i = 0; i < count && pixel < TILE_LANES; i++) {
      __builtin_prefetch(job.next_fifo[pixel] + at, 1, 2);
      at += SLOT;
      if (at >= floats) at = 0, pixel++;
    }
  }
  EVS_INLINE void rest() { lines(TILE_LANES * job.network->fifo_floats()); }
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
  const int line = inputs * FIFO_TAPS;
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
    for (int j = 0; j < FIFO_TAPS; j++) {
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
    weights += FIFO_TAPS;
    in += FEATURE;
  }
  // add the residual, rectify, store
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
    float* out = c.out + (o + n) * FEATURE + (FIFO_TICKS + t) * SLOT + lane;
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
  for (int lane = 0; lane < TILE_LANES; lane += WIDE) convolve_block<INPUTS, N, T>(c, o, t, lane);
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

// Transposition of 16 rows of 16 floats in registers.

// Move float k of row i to float i of column k. In: from(i) and to(k), where rows and columns
// begin.
#if EVS_VECTOR_BITS == 512
template <class From, class To>
EVS_INLINE void transpose_16x16(const From& from, const To& to) {
  __m512 a[16], b[16];
  // load the rows
#pragma GCC unroll 16
  for (int i = 0; i < 16; i++) a[i] = _mm512_loadu_ps(from(i));
  // interleave floats of neighbouring rows, then pairs of floats
#pragma GCC unroll 8
  for (int i = 0; i < 16; i += 2) {
    b[i] = _mm512_unpacklo_ps(a[i], a[i + 1]);
    b[i + 1] = _mm512_unpackhi_ps(a[i], a[i + 1]);
  }
#pragma GCC unroll 4
  for (int i = 0; i < 16; i += 4) {
#pragma GCC unroll 2
    for (int h = 0; h < 2; h++) {
      const __m512d low = _mm512_castps_pd(b[i + h]), high = _mm512_castps_pd(b[i + h + 2]);
      a[i + 2 * h] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, high));
      a[i + 2 * h + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, high));
    }
  }
  // quarter q of a[4 g + c] now holds float 4 q + c of rows 4 g ... 4 g + 3; gather the quarters
#pragma GCC unroll 4
  for (int c = 0; c < 4; c++) {
    const __m512 low_even = _mm512_shuffle_f32x4(a[c], a[4 + c], 0x88);
    const __m512 low_odd = _mm512_shuffle_f32x4(a[c], a[4 + c], 0xdd);
    const __m512 high_even = _mm512_shuffle_f32x4(a[8 + c], a[12 + c], 0x88);
    const __m512 high_odd = _mm512_shuffle_f32x4(a[8 + c], a[12 + c], 0xdd);
    _mm512_storeu_ps(to(c), _mm512_shuffle_f32x4(low_even, high_even, 0x88));
    _mm512_storeu_ps(to(4 + c), _mm512_shuffle_f32x4(low_odd, high_odd, 0x88));
    _mm512_storeu_ps(to(8 + c), _mm512_shuffle_f32x4(low_even, high_even, 0xdd));
    _mm512_storeu_ps(to(12 + c), _mm512_shuffle_f32x4(low_odd, high_odd, 0xdd));
  }
}
#else
// in blocks of 4 x 4
template <class From, class To>
EVS_INLINE void transpose_16x16(const From& from, const To& to) {
  typedef float Four __attribute__((vector_size(16)));
  for (int r = 0; r < 16; r += 4) {
    for (int c = 0; c < 16; c += 4) {
      Four a[4];
#pragma GCC unroll 4
      for (int i = 0; i < 4; i++) __builtin_memcpy(&a[i], from(r + i) + c, sizeof a[i]);
      const Four low = __builtin_shufflevector(a[0], a[1], 0, 4, 1, 5);
      const Four high = __builtin_shufflevector(a[0], a[1], 2, 6, 3, 7);
      const Four low_next = __builtin_shufflevector(a[2], a[3], 0, 4, 1, 5);
      const Four high_next = __builtin_shufflevector(a[2], a[3], 2, 6, 3, 7);
      a[0] = __builtin_shufflevector(low, low_next, 0, 1, 4, 5);
      a[1] = __builtin_shufflevector(low, low_next, 2, 3, 6, 7);
      a[2] = __builtin_shufflevector(high, high_next, 0, 1, 4, 5);
      a[3] = __builtin_shufflevector(high, high_next, 2, 3, 6, 7);
#pragma GCC unroll 4
      for (int i = 0; i < 4; i++) __builtin_memcpy(to(c + i) + r, &a[i], sizeof a[i]);
    }
  }
}
#endif

// The same for any number of rows and columns up to 16.
template <class From, class To>
EVS_INLINE void transpose(const From& from, const To& to, int rows, int columns) {
  if (rows == TILE_LANES && columns == TILE_LANES) return transpose_16x16(from, to);
  for (int i = 0; i < rows; i++) {
    for (int k = 0; k < columns; k++) to(k)[i] = from(i)[k];
  }
}

// Call move(first, count) for blocks of up to 16 of the floats [first, first + count) of the FIFOs.
template <class Move>
EVS_INLINE void for_each_block(int first, int count, const Move& move) {
  if (count < TILE_LANES) return move(first, count);
  for (int at = 0; at < count; at += TILE_LANES) {
    move(first + (at + TILE_LANES <= count ? at : count - TILE_LANES),
         TILE_LANES);  // the last one may overlap
  }
}

// Load the FIFOs into scratch memory.
EVS_INLINE void load_fifos(const InferenceJob& job) {
  for_each_block(0, job.network->fifo_floats(), [&](int at, int count) {
    transpose([&](int i) { return job.fifo[i] + at; },
              [&](int k) { return job.scratch + job.load_places[at + k]; }, TILE_LANES, count);
  });
}

// Shift the FIFO windows in scratch memory by a segment of `ticks`.
EVS_INLINE void shift_fifos(const InferenceJob& job, int ticks) {
  const int features = job.network->features();
  for (int f = 0; f < features; f++) {
    float* slots = job.scratch + static_cast<size_t>(f) * FEATURE;
    for (int at = 0; at < FIFO_TICKS * SLOT; at += LANES) {
      store(slots + at, load(slots + ticks * SLOT + at));
    }
  }
}

// Store the last ticks of every feature in the FIFOs; the last segment had `ticks`.
EVS_INLINE void store_fifos(const InferenceJob& job, int ticks) {
  const float* scratch = job.scratch + ticks * SLOT;
  auto write = [&](int at, int count) {
    transpose([&](int k) { return scratch + job.store_places[at + k]; },
              [&](int i) { return job.fifo[i] + at; }, count, TILE_LANES);
  };
  const int features = job.network->features();
  if (job.ticks >= FIFO_TICKS) return for_each_block(0, FIFO_TICKS * features, write);
  for (int t = 0; t < job.ticks; t++) {
    for_each_block(static_cast<int>((job.tick + t) % FIFO_TICKS) * features, features, write);
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
  if (from > 0) shift_fifos(job, SEGMENT);
  for (int t = 0; t < ticks; t++) {
    float* x = job.scratch + (FIFO_TICKS + t) * SLOT;
    for (int i = 0; i < TILE_LANES; i++) x[i] = job.x[i][(from + t) * TILE_LANES];
  }
  // encoder: h(0) = ReLU[Conv1d(X)]
  const float* weights = net.weights;
  const float* biases = net.biases;
  convolve({weights, biases, channels, 1, inputs_of(0), inputs_of(1), nullptr, ticks}, prefetcher);
  weights += channels * FIFO_TAPS;
  biases += channels;
  const int line = channels * channels * FIFO_TAPS;
  // residual blocks: h(i) = ReLU[h(i-1) + Conv1d(ReLU[Conv1d(h(i-1))])]
  for (int b = 0; b < net.blocks; b++) {
    const int k = 1 + 2 * b;
    convolve({weights, biases, channels, channels, inputs_of(k), inputs_of(k + 1), nullptr, ticks},
             prefetcher);
    const float* residual = inputs_of(k) + (FIFO_TICKS - net.delays[b]) * SLOT;
    convolve({weights + line, biases + channels, channels, channels, inputs_of(k + 1),
              inputs_of(k + 2), residual, ticks},
             prefetcher);
    weights += 2 * line;
    biases += 2 * channels;
  }

  // point-wise convolution: I
  const float* top = inputs_of(net.convolutions()) + FIFO_TICKS * SLOT;
  alignas(64) float current[SEGMENT * TILE_LANES];
  for (int at = 0; at < ticks * TILE_LANES; at += WIDE) {
    Wide sum = wide(net.pointwise_bias);
    for (int c = 0; c < channels; c++) {
      sum = wide_fma(wide(net.pointwise[c]), wide_load(top + c * FEATURE + at), sum);
    }
    wide_store(current + at, sum);
  }
  // write I to each pixel
  for (int i = 0; i < TILE_LANES; i++) {
    for (int t = 0; t < ticks; t++)
      job.current[i][(from + t) * TILE_LANES] = current[t * TILE_LANES + i];
  }
}

// Kernel: the current of 16 pixels through a chunk.
void infer(const InferenceJob& job) {
  load_fifos(job);
  Prefetcher prefetcher{job};
  int from = 0;
  for (; from + SEGMENT < job.ticks; from += SEGMENT) infer_segment(job, from, SEGMENT, prefetcher);
  infer_segment(job, from, job.ticks - from, prefetcher);
  prefetcher.rest();
  store_fifos(job, job.ticks - from);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
