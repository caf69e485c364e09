// Allocation of FIFO memory: which row belongs to which tile.
//
// A tile is given the lowest free row in the tick in which its X becomes non-zero, and releases it
// kChunk ticks after its FIFOs are empty, so that a row released in a chunk holds zeros from the
// start of the chunk on. In each tick rows are allocated first and then released, both in the order
// of the tiles. So the assignment depends on the light alone, not on chunks or threads.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "evsnet/network_kernel.h"

namespace evs {

class FifoRows {
 public:
  // Start a chunk. In: `rows` in memory; `row` of each tile, -1 for none. Throws
  // std::invalid_argument if one does not exist or two tiles share one.
  void begin(const int32_t* row, size_t tiles, size_t rows) {
    free_.assign((std::max(rows, tiles) + 63) / 64, ~uint64_t{0});
    end_ = 0;
    lowest_word_ = 0;
    for (size_t tile = 0; tile < tiles; tile++) {
      if (row[tile] == -1) continue;
      const size_t at = static_cast<size_t>(row[tile]);
      if (row[tile] < -1 || at >= rows || !is_free(at)) {
        throw std::invalid_argument("tile_row is damaged");
      }
      free_[at / 64] &= ~(uint64_t{1} << (at % 64));
      end_ = std::max(end_, at + 1);
    }
    for (std::vector<int32_t>& tick : allocations_) tick.clear();
    for (std::vector<int32_t>& tick : releases_) tick.clear();
    pending_ = false;
  }

  // Request a row for a tile in tick t of the chunk, or its release after that tick.
  void allocate(size_t tile, int t) { append(allocations_[t], tile); }
  void release(size_t tile, int t) { append(releases_[t], tile); }

  // Carry out the requests. In/out: `row` of each tile. Out: rows needed in memory.
  size_t commit(int32_t* row) {
    if (!pending_) return end_;
    for (int t = 0; t < kChunk; t++) {
      for (int32_t tile : allocations_[t]) row[tile] = allocate_lowest();
      for (int32_t tile : releases_[t]) {
        const size_t at = static_cast<size_t>(row[tile]);
        free_[at / 64] |= uint64_t{1} << (at % 64);
        lowest_word_ = std::min(lowest_word_, at / 64);
        row[tile] = -1;
      }
    }
    return end_;
  }

 private:
  bool is_free(size_t at) const { return (free_[at / 64] >> (at % 64) & 1) != 0; }

  void append(std::vector<int32_t>& tick, size_t tile) {
    tick.push_back(static_cast<int32_t>(tile));
    pending_ = true;
  }

  // There is always a free row, since no tile has two.
  int32_t allocate_lowest() {
    while (free_[lowest_word_] == 0) lowest_word_++;
    const size_t at =
        lowest_word_ * 64 + static_cast<size_t>(std::countr_zero(free_[lowest_word_]));
    free_[lowest_word_] &= free_[lowest_word_] - 1;
    end_ = std::max(end_, at + 1);
    return static_cast<int32_t>(at);
  }

  std::vector<uint64_t> free_;  // a bit for each row: 1 if it is free
  size_t lowest_word_ = 0;      // no word before it has a free row
  size_t end_ = 0;              // one past the highest row used in this chunk
  bool pending_ = false;
  std::vector<int32_t> allocations_[kChunk], releases_[kChunk];
};

}  // namespace evs
