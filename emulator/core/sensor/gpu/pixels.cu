// The event pixels `plain` and `adaptive`: a block of 64 pixels a thread, then a scan that packs
// what the blocks have found in the order of the pixels.
#define EVS_ON_DEVICE 1
#include "base/gpu/prelude.h"

#include "sensor/device_pixels.h"

// whether a launch steps many cameras
#ifndef EVS_MANY
#define EVS_MANY 0
#endif

namespace evs {

// Fill the table of photon noise: one thread, once.
extern "C" __global__ void prepare() {
  reinterpret_cast<PassageTable*>(PASSAGE_TABLE_MEMORY)->fill();
}

EVS_INLINE size_t thread_index() {
  return static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
}

EVS_ALWAYS_INLINE void step_block_of_thread(const DevicePixels& d) {
  size_t block = thread_index();
  size_t first = block * BLOCK_PIXELS;
  if (first >= d.pixels) return;
  size_t left = d.pixels - first;
  Scratch scratch;
  BudgetScratch budgets;
  NoisyPixels noisy;
  std::vector<ShotCandidate> shots{d.candidates + block * d.candidate_room, d.candidate_room};
  std::vector<Crossing> out{d.crossings + block * d.crossing_room, d.crossing_room};
  size_t clamped = step_block(d.step, first, left < BLOCK_PIXELS ? left : BLOCK_PIXELS, scratch,
                              budgets, noisy, shots, out);
  d.counts[block] = {static_cast<uint32_t>(out.wanted), static_cast<uint32_t>(shots.wanted),
                     static_cast<uint32_t>(clamped)};
}

#if !EVS_MANY

// Step every block by a tick.
extern "C" __global__ void __launch_bounds__(64)
    step_blocks(const __grid_constant__ DevicePixels d) {
  step_block_of_thread(d);
}

#else

// Step every block of as many cameras as the grid is high. In: their arguments, `stride` bytes
// apart.
extern "C" __global__ void __launch_bounds__(64)
    step_blocks_of_many(const char* cameras, unsigned stride) {
  const char* camera = cameras + static_cast<size_t>(blockIdx.y) * stride;
  step_block_of_thread(*reinterpret_cast<const DevicePixels*>(camera));
}

#endif

// Find where the crossings of each block go: one block of the grid. Out: offsets (blocks,).
extern "C" __global__ void __launch_bounds__(SCAN_THREADS)
    place_crossings(const BlockCounts* counts, unsigned blocks, uint32_t* offsets,
                    TickCounts* all) {
  __shared__ ScanSums<TickCounts> sums;
  place_crossings_of(counts, blocks, offsets, sums, all);
}

// Pack the crossings of all blocks, unless a block or all of them need more room.
extern "C" __global__ void __launch_bounds__(64)
    pack_crossings(const BlockCounts* counts, unsigned blocks, const Crossing* crossings,
                   unsigned crossing_room, const uint32_t* offsets, const TickCounts* all,
                   unsigned room, Crossing* packed) {
  pack_crossings_of(thread_index(), counts, blocks, crossings, crossing_room, offsets, all, room,
                    packed);
}

}  // namespace evs
