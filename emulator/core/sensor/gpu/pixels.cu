// The event pixels `plain` and `adaptive`: a block of 64 pixels a thread, then a scan that packs
// what the blocks have found in the order of the pixels.
#define EVS_ON_DEVICE 1
#include "prelude.h"

#include "device_pixels.h"

// whether a launch steps many cameras
#ifndef EVS_MANY
#define EVS_MANY 0
#endif

namespace evs {

// Fill the table of photon noise: one thread, once.
extern "C" __global__ void prepare() {
  reinterpret_cast<PassageTable*>(kPassageTableMemory)->fill();
}

EVS_ALWAYS_INLINE void step_block_of_thread(const DevicePixels& d) {
  size_t block = static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
  size_t first = block * kBlock;
  if (first >= d.pixels) return;
  size_t left = d.pixels - first;
  Scratch scratch;
  BudgetScratch budgets;
  std::vector<ShotCandidate> shots{d.candidates + block * d.candidate_room, d.candidate_room};
  std::vector<Crossing> out{d.crossings + block * d.crossing_room, d.crossing_room};
  size_t clamped =
      step_block(d.step, first, left < kBlock ? left : kBlock, scratch, budgets, shots, out);
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

// Find where the crossings of each block go: one block of 1024 threads. Out: offsets (blocks,).
extern "C" __global__ void __launch_bounds__(1024)
    place_crossings(const BlockCounts* counts, unsigned blocks, uint32_t* offsets,
                    TickCounts* all) {
  constexpr unsigned THREADS = 1024;
  __shared__ uint32_t ends[THREADS], crossings[THREADS], candidates[THREADS], clamped[THREADS];
  unsigned me = threadIdx.x, each = (blocks + THREADS - 1) / THREADS;
  unsigned begin = me * each, end = begin + each < blocks ? begin + each : blocks;
  uint32_t sum = 0, most = 0, most_candidates = 0, bad = 0;
  for (unsigned b = begin; b < end; b++) {
    sum += counts[b].crossings;
    most = std::max(most, counts[b].crossings);
    most_candidates = std::max(most_candidates, counts[b].candidates);
    bad += counts[b].clamped;
  }
  ends[me] = sum;
  crossings[me] = most, candidates[me] = most_candidates, clamped[me] = bad;
  __syncthreads();
  // sums and maxima over ever more threads before this one (Hillis and Steele 1986)
  for (unsigned step = 1; step < THREADS; step *= 2) {
    bool has = me >= step;
    uint32_t other = has ? ends[me - step] : 0, other_most = has ? crossings[me - step] : 0;
    uint32_t other_candidates = has ? candidates[me - step] : 0;
    uint32_t other_bad = has ? clamped[me - step] : 0;
    __syncthreads();
    ends[me] += other;
    crossings[me] = std::max(crossings[me], other_most);
    candidates[me] = std::max(candidates[me], other_candidates);
    clamped[me] += other_bad;
    __syncthreads();
  }
  uint32_t at = ends[me] - sum;
  for (unsigned b = begin; b < end; b++) {
    offsets[b] = at;
    at += counts[b].crossings;
  }
  if (me == THREADS - 1) *all = {ends[me], crossings[me], candidates[me], clamped[me]};
}

// Pack the crossings of all blocks, in their order, unless a block or all of them need more room.
extern "C" __global__ void __launch_bounds__(64)
    pack_crossings(const BlockCounts* counts, unsigned blocks, const Crossing* crossings,
                   unsigned crossing_room, const uint32_t* offsets, const TickCounts* all,
                   unsigned room, Crossing* packed) {
  unsigned block = blockIdx.x * blockDim.x + threadIdx.x;
  if (block >= blocks) return;
  if (all->crossings > room || all->most_crossings > crossing_room) return;
  const Crossing* from = crossings + static_cast<size_t>(block) * crossing_room;
  Crossing* to = packed + offsets[block];
  uint32_t count = counts[block].crossings;
  for (uint32_t i = 0; i < count; i++) to[i] = from[i];
}

}  // namespace evs
