// What the kernels of EvSNet work on: plain numbers and pointers.
//
// The wide code of each instruction set includes this file, so it includes nothing of the standard
// library that has code, and its functions are always inlined (base/simd_target.h).
//
// Pixels go in tiles of 4 x 4, whose pixels are the 16 lanes, row by row. Lanes outside the image
// never fire. L is luminance, L_log the log intensity, X the log intensity difference, I the
// current that the convolutions give, V the membrane potential, S the spike.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sensor/log_map.h"

namespace evs {

inline constexpr int TILE_SIDE = 4;
inline constexpr int TILE_LANES = TILE_SIDE * TILE_SIDE;
inline constexpr int FIFO_TAPS = 7;
// Ticks that the FIFO window of a convolution holds of each input, before the current one.
inline constexpr int FIFO_TICKS = FIFO_TAPS - 1;
// Ticks that pass through all layers together, so that the features of two layers fit into the L1
// cache.
inline constexpr int SEGMENT = 16;
// Ticks of one feature in scratch memory: the FIFO window, then the segment.
inline constexpr int SLOTS = FIFO_TICKS + SEGMENT;
// Longest chunk; longer ones are split. The ticks of a chunk are the bits of a word.
inline constexpr int TICK_CHUNK = 32;
inline constexpr float LARGEST_X = 20.0f;
inline constexpr float LARGEST_V = 64.0f;
inline constexpr int MOST_SPIKES = 64;
inline constexpr int DECAY_LOW = 256;
inline constexpr int DECAY_HIGH = 4096;

// The filters, laid out as in emulator/evsnet/weights.py. Convolution 0 is the encoder; each
// residual block has two more.
struct Network {
  int channels = 0;
  int blocks = 0;                    // M
  const float* weights = nullptr;    // (out, in, 7) of each convolution, one after another
  const float* biases = nullptr;     // (convolutions, channels)
  const int32_t* delays = nullptr;   // (blocks,) ticks by which the residual sum is late, 0 ... 6
  const float* pointwise = nullptr;  // (channels,) of the last, point-wise convolution
  float pointwise_bias = 0.0f;

  EVS_ALWAYS_INLINE int convolutions() const { return 1 + 2 * blocks; }
  // Inputs of all convolutions: X, then the channels of every layer but the last.
  EVS_ALWAYS_INLINE int features() const { return 1 + 2 * blocks * channels; }
  // First input of a convolution; for the one past the last, the first output of the network.
  EVS_ALWAYS_INLINE int first_feature(int convolution) const {
    return convolution == 0 ? 0 : 1 + (convolution - 1) * channels;
  }
  // Past ticks in the receptive field (W - 1): once X was 0 for so long, nothing of it is left.
  EVS_ALWAYS_INLINE int past_ticks() const { return FIFO_TICKS * convolutions(); }
  // Floats in the FIFOs of a pixel: [6][feature]; tick n is in slot n mod 6.
  EVS_ALWAYS_INLINE int fifo_floats() const { return FIFO_TICKS * features(); }
  // Floats in the FIFOs of a tile, pixel by pixel.
  EVS_ALWAYS_INLINE size_t row_floats() const {
    return static_cast<size_t>(fifo_floats()) * TILE_LANES;
  }
  // Floats of scratch memory: [feature][22][16], then as much for each output channel.
  EVS_ALWAYS_INLINE size_t scratch_floats() const {
    return static_cast<size_t>(features() + channels) * SLOTS * TILE_LANES;
  }
  EVS_ALWAYS_INLINE size_t weight_floats() const {
    const size_t c = static_cast<size_t>(channels);
    return c * FIFO_TAPS + 2 * static_cast<size_t>(blocks) * c * c * FIFO_TAPS;
  }
};

// The bipolar leaky integrate-and-fire unit. d is the leak of one tick, e^(-dt / tau).
struct BiLif {
  float v_on = 1.0f;
  float v_off = 1.0f;
  int most = 1;                       // spikes of a pixel in a tick
  const float* decay_low = nullptr;   // (256,) d^m
  const float* decay_high = nullptr;  // (4096,) d^(256 m); decay_high[0] is 1
};

// Where a tile lies in the image.
struct TilePlace {
  size_t pixel = 0;  // of its first lane
  size_t width = 0;  // of the image
  int columns = TILE_SIDE;
  int rows = TILE_SIDE;

  EVS_ALWAYS_INLINE bool whole() const { return columns == TILE_SIDE && rows == TILE_SIDE; }
  // The lanes inside the image, as bits.
  EVS_ALWAYS_INLINE uint32_t lanes() const {
    return ((1u << columns) - 1u) * 0x1111u & ((1u << (TILE_SIDE * rows)) - 1u);
  }
};

// Luminance of a chunk to log intensity differences.
struct LogDeltaJob {
  LogMap map;
  uint32_t unusable_from = 0;  // bits of the smallest positive luminance that is unusable
  const float* luminance = nullptr;
  size_t frame = 0;  // pixels of an image
  int64_t tick = 0;  // number of the first tick
  int ticks = 0;
  float* last_luminance = nullptr;
  float* last_log = nullptr;
};

struct LogDeltaCounts {
  int64_t clamped = 0;
  int64_t x_clamped = 0;
};

// 16 pixels through all layers for a chunk, wherever they lie in the image. Where there are fewer,
// some occupy several lanes, which all compute the same.
struct InferenceJob {
  const Network* network = nullptr;
  float* scratch = nullptr;
  // where each float of a pixel's FIFOs is in scratch memory, before the chunk and after it
  const int32_t* load_places = nullptr;
  const int32_t* store_places = nullptr;
  int64_t tick = 0;  // number of the first tick
  int ticks = 0;
  float* fifo[TILE_LANES];             // In/out
  const float* next_fifo[TILE_LANES];  // of the next 16 pixels, to be prefetched
  const float* x[TILE_LANES];          // X; tick t is 16 t floats on
  float* current[TILE_LANES];          // Out: I, with the same stride
};

// The membranes of a tile through a chunk.
struct BiLifJob {
  const BiLif* unit = nullptr;
  const float* current = nullptr;  // (ticks, 16)
  int64_t tick = 0;                // number of the first tick
  int ticks = 0;
  TilePlace place;
  float* v = nullptr;       // In/out, of the image
  int64_t* last = nullptr;  // In/out, of the image: the tick that each v is as of

  // Out
  uint32_t fired = 0;                                 // ticks with a spike, as bits
  uint16_t on[TICK_CHUNK];                            // lanes with ON spikes, as bits
  uint16_t off[TICK_CHUNK];                           // lanes with OFF spikes
  alignas(64) float leaked[TICK_CHUNK * TILE_LANES];  // d V at the start of the ticks with a spike
  alignas(64) float count[TICK_CHUNK * TILE_LANES];  // spikes of the lanes that fire in these ticks
  int v_clamped = 0;
  bool at_threshold = false;  // some V is still at a threshold
};

// The kernels of one instruction set.
struct NetworkKernel {
  // Mark in `ticks`, for each tile of a row of tiles, the ticks in which luminance changed or is
  // unusable. In: `pixel`, where the row begins; `rows` of pixels, 1 ... 4.
  void (*find_changes)(const LogDeltaJob& job, size_t pixel, size_t width, int rows,
                       uint32_t* ticks);
  // X of a tile, (ticks, 16). In: `changed`, ticks as bits. In/out: `moved`, for each lane the last
  // tick with X != 0. Out: the ticks in which some X is not 0.
  uint32_t (*log_delta)(const LogDeltaJob& job, const TilePlace& place, uint32_t changed, float* x,
                        int64_t* moved, LogDeltaCounts& counts);
  void (*infer)(const InferenceJob& job);
  void (*integrate_and_fire)(BiLifJob& job);
};

extern const NetworkKernel NETWORK_AVX512;
extern const NetworkKernel NETWORK_AVX2;
extern const NetworkKernel NETWORK_NEON;
extern const NetworkKernel NETWORK_PORTABLE;
extern const NetworkKernel NETWORK_ONE_LANE;

}  // namespace evs
