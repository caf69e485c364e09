// What the kernels of the network work on: plain numbers and pointers. The files of one instruction
// set include it, so nothing of the standard library comes in here, and every function is inline in
// fact: none may come out with instructions that the machine lacks.
//
// Tiles of 4 x 4 pixels are 16 lanes, row by row. Lanes beyond the image are silent.
#pragma once

#include <cstddef>
#include <cstdint>

#include "log_map.h"

namespace evs {

inline constexpr int kSide = 4;
inline constexpr int kLanes = kSide * kSide;
inline constexpr int kTaps = 7;
// Ticks that a convolution remembers of each of its inputs.
inline constexpr int kOld = kTaps - 1;
// Ticks that go through all layers at once: then what two layers hold fits in the first cache.
inline constexpr int kStretch = 16;
// One input of a convolution in scratch memory: the old ticks, then the new ones.
inline constexpr int kSlots = kOld + kStretch;
// Ticks of one chunk: longer ones are cut. A tile's ticks are the bits of a word.
inline constexpr int kChunk = 32;
inline constexpr float kLargestX = 20.0f;
inline constexpr float kLargestV = 64.0f;
inline constexpr int kDecayLow = 256;
inline constexpr int kDecayHigh = 4096;

// The filters, as emulator/network/weights.py has them. Convolutions are 0 (the encoder), then two
// of each block.
struct Net {
  int channels = 0;
  int blocks = 0;
  const float* weights = nullptr;   // of each convolution (out, in, 7), one after another
  const float* biases = nullptr;    // (convolutions, channels)
  const int32_t* delays = nullptr;  // (blocks,) ticks by which a block's sum is late, 0 ... 6
  const float* last = nullptr;      // (channels,)
  float last_bias = 0.0f;

  EVS_ALWAYS_INLINE int convolutions() const { return 1 + 2 * blocks; }
  // Inputs of all convolutions together.
  EVS_ALWAYS_INLINE int features() const { return 1 + 2 * blocks * channels; }
  // Where the inputs of a convolution begin; of the one after the last: what the network gives.
  EVS_ALWAYS_INLINE int first_feature(int convolution) const {
    return convolution == 0 ? 0 : 1 + (convolution - 1) * channels;
  }
  // Ticks for which X must have been 0 so that nothing of it is left.
  EVS_ALWAYS_INLINE int window() const { return kOld * convolutions(); }
  // Floats that a pixel remembers: [6][feature]; tick n is in slot n mod 6.
  EVS_ALWAYS_INLINE int pixel_floats() const { return kOld * features(); }
  // Floats that a tile remembers, pixel by pixel.
  EVS_ALWAYS_INLINE size_t row_floats() const {
    return static_cast<size_t>(pixel_floats()) * kLanes;
  }
  // Floats of scratch memory: [feature][22][16], and as many for the output.
  EVS_ALWAYS_INLINE size_t scratch_floats() const {
    return static_cast<size_t>(features() + channels) * kSlots * kLanes;
  }
  EVS_ALWAYS_INLINE size_t weight_floats() const {
    const size_t c = static_cast<size_t>(channels);
    return c * kTaps + 2 * static_cast<size_t>(blocks) * c * c * kTaps;
  }
};

// BiLIF.
struct Membrane {
  float on = 1.0f;              // V_on
  float off = 1.0f;             // V_off
  const float* low = nullptr;   // (256,) d^m
  const float* high = nullptr;  // (4096,) d^(256 m); high[0] is 1
};

// Where a tile lies in an image.
struct TilePlace {
  size_t pixel = 0;  // of its first lane
  size_t width = 0;  // of the image
  int columns = kSide;
  int rows = kSide;

  EVS_ALWAYS_INLINE bool whole() const { return columns == kSide && rows == kSide; }
  EVS_ALWAYS_INLINE bool inside(int lane) const {
    return lane % kSide < columns && lane / kSide < rows;
  }
  EVS_ALWAYS_INLINE uint32_t lanes() const {
    return ((1u << columns) - 1u) * 0x1111u & ((1u << (kSide * rows)) - 1u);
  }
};

// The light of a chunk and what the pixels saw last.
struct Front {
  LogMap map;
  uint32_t unusable_from = 0;  // bits of the least positive luminance that is none
  const float* luminance = nullptr;
  size_t frame = 0;  // pixels of an image
  int64_t tick = 0;  // number of the first
  int ticks = 0;
  float* last_luminance = nullptr;
  float* last_log = nullptr;
};

struct FrontCounts {
  int64_t clamped = 0;
  int64_t x_clamped = 0;
};

// 16 pixels through a chunk, wherever they lie. With fewer, some are told twice: the same comes
// out.
struct PixelJob {
  const Net* net = nullptr;
  float* scratch = nullptr;
  // where each float that a pixel remembers is in scratch memory: before the chunk, and after it
  const int32_t* old_places = nullptr;
  const int32_t* new_places = nullptr;
  int64_t tick = 0;  // number of the first
  int ticks = 0;
  float* row[kLanes];             // In/out, what it remembers
  const float* next_row[kLanes];  // of the next pixels, to be fetched
  const float* x[kLanes];         // X of tick t is 16 t floats behind
  float* current[kLanes];         // Out, I, the same way
};

// A tile's membranes through a chunk.
struct TileJob {
  const Membrane* membrane = nullptr;
  const float* current = nullptr;  // (ticks, 16)
  int64_t tick = 0;                // number of the first
  int ticks = 0;
  TilePlace place;
  float* v = nullptr;       // In/out, of the image
  int64_t* last = nullptr;  // In/out, of the image

  // Out
  uint32_t fired = 0;  // ticks with an event
  uint16_t on[kChunk];
  uint16_t off[kChunk];
  alignas(64) float before[kChunk * kLanes];  // V at the start of the tick, where one fired
  int v_clamped = 0;
  bool loud = false;  // a pixel is over its threshold still
};

// One build of the kernels.
struct NetworkKernel {
  // Note in `flags`, of each tile of a row of tiles, the ticks whose light changed or is none.
  // In: `pixel`, where the row begins; `rows` of pixels, 1 ... 4.
  void (*look)(const Front& front, size_t pixel, size_t width, int rows, uint32_t* flags);
  // Light of a tile to X (ticks, 16). Out: the ticks at which some X is not 0; of each lane with
  // one, the last in `moved`.
  uint32_t (*to_x)(const Front& front, const TilePlace& place, uint32_t flags, float* x,
                   int64_t* moved, FrontCounts& counts);
  void (*infer)(const PixelJob& job);
  void (*fire)(TileJob& job);
};

extern const NetworkKernel NETWORK_AVX512;
extern const NetworkKernel NETWORK_AVX2;
extern const NetworkKernel NETWORK_PORTABLE;

}  // namespace evs
