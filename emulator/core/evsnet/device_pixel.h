// What a thread of a device does in each kernel of EvSNet: the lanes of the CPU's kernels, one
// lane.
//
// CHANNELS is the number of channels where the compiler knows it, else 0.
#pragma once

#ifndef EVS_VECTOR_BITS
#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE network_device
#endif
#ifndef EVS_UNROLL
#define EVS_UNROLL(count)
#endif

#include "base/scan.h"
#include "evsnet/bilif.inl"
#include "evsnet/device_network.h"
#include "evsnet/log_delta.inl"
#include "evsnet/spike_time.h"
#include "evsnet/wide_register.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int MOST_CHANNELS = 64;

// Four weights that are loaded together.
struct alignas(16) FourWeights {
  float w[4];
};

// The FIFOs of a pixel in a tick. Tap 6 is the tick itself.
struct PixelFifo {
  float* tap[FIFO_TICKS];  // of its first feature, six ticks ago ... one tick ago
  size_t stride;           // from feature to feature

  EVS_INLINE size_t place(int feature) const { return stride * static_cast<size_t>(feature); }
  // The slot of six ticks ago is that of the tick itself.
  EVS_INLINE void push(int feature, float value) { tap[0][place(feature)] = value; }
  // The features of so many ticks ago, 1 ... 6.
  EVS_INLINE const float* ago(int ticks) const {
    const float* found = tap[0];
    EVS_UNROLL(6)
    for (int j = 1; j < FIFO_TICKS; j++) found = FIFO_TICKS - j == ticks ? tap[j] : found;
    return found;
  }
};

EVS_INLINE PixelFifo fifo_of(const DeviceNetwork& net, int64_t tick, size_t pixel) {
  PixelFifo fifo;
  fifo.stride = net.pixels();
  const size_t slot = fifo.stride * static_cast<size_t>(net.network.features());
  EVS_UNROLL(6)
  for (int j = 0; j < FIFO_TICKS; j++) {
    fifo.tap[j] = net.arrays.fifo + static_cast<size_t>((tick + j) % FIFO_TICKS) * slot + pixel;
  }
  return fifo;
}

// N outputs from `o` on. In: `now`, the inputs of this tick; those before it are features from
// `first` on. Order of the sum as in convolutions.inl.
template <int N, int INPUTS>
EVS_INLINE void convolve_outputs(const float* weights, const float* biases, int stride,
                                 const PixelFifo& fifo, int first, const float* now, int inputs,
                                 int o, float* sum) {
  EVS_UNROLL(8)
  for (int n = 0; n < N; n++) sum[n] = biases[o + n];
  const float* line = weights + o;
  // few inputs are unrolled, so that `now` stays in registers
  EVS_UNROLL((INPUTS > 0 && INPUTS <= 8 ? INPUTS : 1))
  for (int i = 0; i < (INPUTS > 0 ? INPUTS : inputs); i++) {
    const size_t place = fifo.place(first + i);
    EVS_UNROLL(7)
    for (int j = 0; j < FIFO_TAPS; j++) {
      const float x = j < FIFO_TICKS ? fifo.tap[j][place] : now[i];
      EVS_UNROLL(2)
      for (int q = 0; q < N; q += 4) {
        const FourWeights four = *reinterpret_cast<const FourWeights*>(line + q);
        EVS_UNROLL(4)
        for (int n = 0; n < 4; n++) sum[q + n] = wide_fma(four.w[n], x, sum[q + n]);
      }
      line += stride;
    }
  }
}

// The same for all outputs, in blocks of eight; done(o, sum, count) takes what a block gives.
template <int CHANNELS, int INPUTS, class Done>
EVS_INLINE void convolve(const float* weights, const float* biases, int channels,
                         const PixelFifo& fifo, int first, const float* now, int inputs,
                         const Done& done) {
  const int stride = output_stride(CHANNELS > 0 ? CHANNELS : channels);
  EVS_UNROLL(1)
  for (int o = 0; o < stride; o += 8) {
    float sum[8];
    if (stride - o < 8) {
      convolve_outputs<4, INPUTS>(weights, biases, stride, fifo, first, now, inputs, o, sum);
      done(o, sum, 4);
    } else {
      convolve_outputs<8, INPUTS>(weights, biases, stride, fifo, first, now, inputs, o, sum);
      done(o, sum, 8);
    }
  }
}

// The current of a pixel, as `infer` of convolutions.inl.
template <int CHANNELS>
EVS_INLINE float infer_pixel(const DeviceNetwork& device, int64_t tick, size_t pixel, float x) {
  const Network& net = device.network;
  const int channels = CHANNELS > 0 ? CHANNELS : net.channels, stride = output_stride(channels);
  constexpr int ROOM = output_stride(CHANNELS > 0 ? CHANNELS : MOST_CHANNELS);
  float outer[ROOM], inner[ROOM];
  PixelFifo fifo = fifo_of(device, tick, pixel);
  const float* weights = net.weights;
  const float* biases = net.biases;
  // encoder: h(0) = ReLU[Conv1d(X)]
  convolve<CHANNELS, 1>(weights, biases, channels, fifo, 0, &x, 1,
                        [&](int o, const float* sum, int count) {
                          EVS_UNROLL(8)
                          for (int n = 0; n < count; n++) outer[o + n] = wide_relu(sum[n]);
                        });
  fifo.push(0, x);
  weights += stride * FIFO_TAPS;
  biases += stride;
  const int line = channels * stride * FIFO_TAPS;
  // residual blocks: h(i) = ReLU[h(i-1) + Conv1d(ReLU[Conv1d(h(i-1))])]
  EVS_UNROLL(1)
  for (int b = 0; b < net.blocks; b++) {
    const int first = net.first_feature(1 + 2 * b), second = net.first_feature(2 + 2 * b);
    const int delay = net.delays[b];
    const float* late = fifo.ago(delay);
    convolve<CHANNELS, CHANNELS>(weights, biases, channels, fifo, first, outer, channels,
                                 [&](int o, const float* sum, int count) {
                                   EVS_UNROLL(8)
                                   for (int n = 0; n < count; n++) inner[o + n] = wide_relu(sum[n]);
                                 });
    convolve<CHANNELS, CHANNELS>(weights + line, biases + stride, channels, fifo, second, inner,
                                 channels, [&](int o, const float* sum, int count) {
                                   EVS_UNROLL(8)
                                   for (int n = 0; n < count; n++) {
                                     if (o + n >= channels) continue;
                                     const float before = outer[o + n];
                                     const int feature = first + o + n;
                                     const float residual =
                                         delay == 0 ? before : late[fifo.place(feature)];
                                     fifo.push(feature, before);
                                     outer[o + n] = wide_relu(residual + sum[n]);
                                   }
                                 });
    EVS_UNROLL((CHANNELS > 0 && CHANNELS <= 8 ? CHANNELS : 1))
    for (int c = 0; c < channels; c++) fifo.push(second + c, inner[c]);
    weights += 2 * line;
    biases += 2 * stride;
  }
  // point-wise convolution: I
  float sum = net.pointwise_bias;
  EVS_UNROLL((CHANNELS > 0 && CHANNELS <= 8 ? CHANNELS : 1))
  for (int c = 0; c < channels; c++) sum = wide_fma(net.pointwise[c], outer[c], sum);
  return sum;
}

// Step a pixel by a tick. In: luminance (h, w).
template <int CHANNELS>
EVS_INLINE void step_pixel(const DeviceNetwork& net, int64_t tick, const float* luminance,
                           size_t pixel) {
  if (pixel >= net.pixels()) return;
  const DeviceNetworkArrays& arrays = net.arrays;
  const Mask inside = mask_from_bits(ALL_LANES);
  uint32_t marks = 0;
  // X, where the light has changed
  const Float now = load(luminance + pixel);
  Float last_luminance = load(arrays.last_luminance + pixel), x = splat(0.0f);
  int64_t moved = arrays.moved[pixel];
  if (as_int(now).v != as_int(last_luminance).v ||
      static_cast<uint32_t>(as_int(now).v) >= net.unusable_from) {
    Float last_log = load(arrays.last_log + pixel);
    const float dn = to_dn(net.map, now.v);
    const float part = log_part<LogKind::LINLOG>(net.map, dn);
    const LogDelta delta =
        log_delta_lanes(net.map, now, splat(dn), splat(part), inside, last_luminance, last_log);
    store(arrays.last_luminance + pixel, last_luminance);
    store(arrays.last_log + pixel, last_log);
    x = delta.x;
    if (any(delta.nonzero)) arrays.moved[pixel] = moved = tick;
    if (!any(delta.usable)) marks |= CLAMPED_BIT;
    if (!any(delta.unclamped)) marks |= X_CLAMPED_BIT;
  }
  // I, while something of X is left
  Float current = splat(0.0f);
  if (net.dense != 0 || moved >= tick - net.network.past_ticks()) {
    current = splat(infer_pixel<CHANNELS>(net, tick, pixel, x.v));
  }
  store(arrays.current + pixel, current);
  // the membrane
  Float v = load(arrays.v + pixel);
  Int last_active = splat(relative_tick(arrays.last[pixel], tick));
  Fired fired;
  if (integrate_and_fire_lanes(net.bilif, current, 0, inside, v, last_active, fired)) {
    store(arrays.v + pixel, v);
    arrays.last[pixel] = tick;
    if (any(fired.clamped)) marks |= V_CLAMPED_BIT;
    if (any(fired.on | fired.off)) {
      store(arrays.leaked + pixel, fired.leaked);
      marks |= static_cast<uint32_t>(truncate(fired.count).v) | (any(fired.on) ? ON_BIT : 0u);
    }
  }
  arrays.marks[pixel] = static_cast<uint16_t>(marks);
}

// Count what the pixels of a group did.
EVS_INLINE void sum_group(const DeviceNetwork& net, size_t group) {
  const size_t groups = net.groups();
  if (group >= groups) return;
  const size_t first = group * TILE_GROUP, left = net.pixels() - first;
  uint32_t sums[GROUP_COUNTS] = {};
  for (size_t i = 0; i < (left < TILE_GROUP ? left : TILE_GROUP); i++) {
    const uint32_t marks = net.arrays.marks[first + i];
    sums[0] += marks & SPIKE_BITS;
    sums[1] += (marks & CLAMPED_BIT) != 0 ? 1u : 0u;
    sums[2] += (marks & X_CLAMPED_BIT) != 0 ? 1u : 0u;
    sums[3] += (marks & V_CLAMPED_BIT) != 0 ? 1u : 0u;
  }
  EVS_UNROLL(4)
  for (size_t k = 0; k < GROUP_COUNTS; k++) net.arrays.groups[k * groups + group] = sums[k];
}

// Sum the counts of one kind of the groups before each, by all threads of a scan.
EVS_INLINE void scan_groups_of(const DeviceNetwork& net, size_t kind, ScanSums<uint32_t>& sums) {
  uint32_t* counts = net.arrays.groups + kind * net.groups();
  auto put = [&](size_t group, uint32_t before) { counts[group] = before; };
  scan(counts, net.groups(), sums, put, net.arrays.totals + kind);
}

// Write the crossings of a pixel where they go.
EVS_INLINE void write_crossings_of(const DeviceNetwork& net, Crossing* crossings, size_t pixel) {
  if (pixel >= net.pixels()) return;
  const uint32_t marks = net.arrays.marks[pixel];
  const int count = static_cast<int>(marks & SPIKE_BITS);
  if (count == 0) return;
  const size_t group = pixel / TILE_GROUP;
  size_t at = net.arrays.groups[group];
  for (size_t i = group * TILE_GROUP; i < pixel; i++) at += net.arrays.marks[i] & SPIKE_BITS;
  const bool on = (marks & ON_BIT) != 0;
  const double threshold = on ? net.bilif.v_on : -net.bilif.v_off;
  const double leaked = net.arrays.leaked[pixel], current = net.arrays.current[pixel];
  for (int n = 1; n <= count; n++) {
    const uint32_t stamp = spike_time(leaked, current, threshold, n, net.tick_us);
    crossings[at++] = {static_cast<uint32_t>(pixel), (stamp << TAG_BITS) | (on ? 1u : 0u)};
  }
}

// The FIFOs of a pixel in the rows of tiles, as NetworkArrays has them: copy them from there, zeros
// where the tile has no row, or to there. In: tile_row (tiles,), -1 for none.
template <bool TO_ROWS>
EVS_INLINE void copy_fifos(const DeviceNetwork& net, const int32_t* tile_row, float* rows,
                           size_t pixel) {
  if (pixel >= net.pixels()) return;
  const size_t x = pixel % net.width, y = pixel / net.width;
  const size_t across = (net.width + TILE_SIDE - 1) / TILE_SIDE;
  const int32_t row = tile_row[y / TILE_SIDE * across + x / TILE_SIDE];
  if (TO_ROWS && row < 0) return;
  const size_t lane = y % TILE_SIDE * TILE_SIDE + x % TILE_SIDE;
  const size_t floats = static_cast<size_t>(net.network.fifo_floats());
  float* line = row < 0 ? nullptr : rows + (static_cast<size_t>(row) * TILE_LANES + lane) * floats;
  for (size_t i = 0; i < floats; i++) {
    float& here = net.arrays.fifo[i * net.pixels() + pixel];
    if (TO_ROWS) {
      line[i] = here;
    } else {
      here = line == nullptr ? 0.0f : line[i];
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
