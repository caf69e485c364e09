// Which row of the FIFO memory belongs to which tile.
//
// A tile takes the lowest free row in the tick in which it moves (X is not 0), and gives it back
// kChunk ticks after nothing is left of that in its FIFOs, so that a row given back in a chunk
// holds zeros from the start of the chunk on. In each tick rows are taken first, then given back,
// both in the order of the tiles: who has which row follows from what moved when, whatever the
// chunks and threads.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "network_kernel.h"

namespace evs {

class PoolRows {
 public:
  // In: `rows` there are; `row` of each tile, -1: none. Throws std::invalid_argument where those
  // are no rows or two tiles share one.
  void begin(const int32_t* row, size_t tiles, size_t rows) {
    words_.assign((std::max(rows, tiles) + 63) / 64, ~uint64_t{0});
    high_ = 0;
    lowest_ = 0;
    for (size_t tile = 0; tile < tiles; tile++) {
      if (row[tile] == -1) continue;
      const size_t at = static_cast<size_t>(row[tile]);
      if (row[tile] < -1 || at >= rows || !is_free(at)) {
        throw std::invalid_argument("tile_row is damaged");
      }
      words_[at / 64] &= ~(uint64_t{1} << (at % 64));
      high_ = std::max(high_, at + 1);
    }
    for (std::vector<int32_t>& tick : taking_) tick.clear();
    for (std::vector<int32_t>& tick : giving_) tick.clear();
    busy_ = false;
  }

  // A tile takes a row in tick t of the chunk, or gives it back after it.
  void take(size_t tile, int t) { note(taking_[t], tile); }
  void give(size_t tile, int t) { note(giving_[t], tile); }

  // Do all of it. In/out: `row` of each tile. Out: how many rows there must be.
  size_t settle(int32_t* row) {
    if (!busy_) return high_;
    for (int t = 0; t < kChunk; t++) {
      for (int32_t tile : taking_[t]) row[tile] = take_lowest();
      for (int32_t tile : giving_[t]) {
        const size_t at = static_cast<size_t>(row[tile]);
        words_[at / 64] |= uint64_t{1} << (at % 64);
        lowest_ = std::min(lowest_, at / 64);
        row[tile] = -1;
      }
    }
    return high_;
  }

 private:
  bool is_free(size_t at) const { return (words_[at / 64] >> (at % 64) & 1) != 0; }

  void note(std::vector<int32_t>& tick, size_t tile) {
    tick.push_back(static_cast<int32_t>(tile));
    busy_ = true;
  }

  // There is always one: no tile has two.
  int32_t take_lowest() {
    while (words_[lowest_] == 0) lowest_++;
    const size_t at = lowest_ * 64 + static_cast<size_t>(std::countr_zero(words_[lowest_]));
    words_[lowest_] &= words_[lowest_] - 1;
    high_ = std::max(high_, at + 1);
    return static_cast<int32_t>(at);
  }

  std::vector<uint64_t> words_;  // a bit a row: it is free
  size_t lowest_ = 0;            // no word before has a free one
  size_t high_ = 0;              // rows up to the last that was ever taken in this chunk
  bool busy_ = false;
  std::vector<int32_t> taking_[kChunk], giving_[kChunk];
};

}  // namespace evs
