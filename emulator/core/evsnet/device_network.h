// EvSNet on a device with memory of its own: the arguments of its kernels.
//
// A thread is a pixel, and computes it as a lane of the CPU's kernels does. What its pixel fires is
// counted for groups of pixels; a scan of the groups says where the crossings of each pixel go, in
// the order of the pixels.
#pragma once

#include <cstddef>
#include <cstdint>

#include "evsnet/network_kernel.h"
#include "sensor/comparator.h"

namespace evs {

// Pixels whose spikes are counted together.
inline constexpr size_t TILE_GROUP = 32;
// What a pixel did in a tick, as bits: its spikes, 0 ... 64, and these.
inline constexpr uint32_t SPIKE_BITS = 0x7f;
inline constexpr uint32_t ON_BIT = 0x80;
inline constexpr uint32_t CLAMPED_BIT = 0x100;
inline constexpr uint32_t X_CLAMPED_BIT = 0x200;
inline constexpr uint32_t V_CLAMPED_BIT = 0x400;
// What is counted of a group: spikes, then pixels with each of the last three bits.
inline constexpr int GROUP_COUNTS = 4;

// Of pixels, all in row-major order.
struct DeviceNetworkArrays {
  // the state, In/out
  float* last_luminance = nullptr;  // (h, w)
  float* last_log = nullptr;        // (h, w)
  float* v = nullptr;               // (h, w)
  int64_t* last = nullptr;          // (h, w)
  int64_t* moved = nullptr;         // (h, w) number of the last tick with X != 0
  float* fifo = nullptr;            // (6, feature, h, w); tick n is in slot n mod 6
  // what a tick gives, Out
  float* current = nullptr;    // (h, w)
  float* leaked = nullptr;     // (h, w) d V at the start of the tick, of pixels that fire
  uint16_t* marks = nullptr;   // (h, w) the bits above
  uint32_t* groups = nullptr;  // (4, groups) the counts of each group; then, of those before it
  uint32_t* totals = nullptr;  // (4,) of all groups
};

// The argument of every kernel.
struct DeviceNetwork {
  Network network;  // for each input and tap, its weight for each output, `stride` of them
  BiLif bilif;
  LogMap map;
  uint32_t unusable_from = 0;
  int dense = 0;  // compute every pixel in every tick
  size_t width = 0;
  size_t height = 0;
  double tick_us = 0.0;
  DeviceNetworkArrays arrays;

  EVS_ALWAYS_INLINE size_t pixels() const { return width * height; }
  EVS_ALWAYS_INLINE size_t groups() const { return (pixels() + TILE_GROUP - 1) / TILE_GROUP; }
};

// Outputs that lie together: channels, filled up with filters of zeros to four.
EVS_ALWAYS_INLINE constexpr int output_stride(int channels) { return (channels + 3) / 4 * 4; }

}  // namespace evs
