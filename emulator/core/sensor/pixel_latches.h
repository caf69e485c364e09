// Events that pixels hold until they are read: at most one a pixel, found by row.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace evs {

// For each row the chain of its requests, latest first, and a bit for each row that has any. Most
// rows hold one request or few; of a row with many, each pixel has a bit as well. Call clear first.
class PixelLatches {
 public:
  PixelLatches(int width, int height)
      : width_(static_cast<size_t>(width)),
        height_(static_cast<size_t>(height)),
        words_((width_ + 63) / 64) {}

  // Allocate the memory and clear all latches. In: count; the index of each request is below it.
  void clear(size_t count) {
    if (rows_.empty()) {
      rows_.assign(height_, Row{0, 0});
      used_.assign((height_ + 63) / 64, 0);
      groups_.assign((used_.size() + 63) / 64, 0);
      pixels_.assign(words_ * height_, 0);
      columns_.resize(width_);
      taken_.resize(width_);
    }
    take_all([](uint32_t) {});
    // free the memory of a burst
    constexpr size_t KEEP = 1 << 16;
    if (chain_.size() > KEEP && count <= KEEP) std::vector<Latched>().swap(chain_);
    if (chain_.size() < count) chain_.resize(count);
  }

  // Latch a request; false if the pixel holds one already.
  bool set(int x, int y, uint32_t index) {
    const size_t column = static_cast<size_t>(x), place = static_cast<size_t>(y);
    uint64_t& word = pixels_[place * words_ + column / 64];
    const uint64_t bit = uint64_t{1} << (column % 64);
    if (word & bit) return false;
    word |= bit;
    used_[place / 64] |= uint64_t{1} << (place % 64);
    groups_[place / 4096] |= uint64_t{1} << (place / 64 % 64);
    Row& row = rows_[place];
    chain_[index] = Latched{row.latest, static_cast<int32_t>(column)};
    row = Row{index, row.count + 1};
    return true;
  }

  // The next row after `row` with a request, wrapping around; `row` >= -1, and some row has one.
  // Which word of bits has it cannot be predicted, so up to 4096 rows there is no branch.
  size_t row_after(int64_t row) const {
    size_t place = static_cast<size_t>(row + 1);
    if (place >= height_) place = 0;
    const size_t w = place / 64;
    const uint64_t here = used_[w] & (~uint64_t{0} << (place % 64));
    // the next other word with a bit; this one again if there is none
    size_t g = w / 64;
    uint64_t group = groups_[g] & (~uint64_t{1} << (w % 64));
    if (groups_.size() == 1) {
      group |= groups_[0] & all_if(group == 0);
    } else {
      while (group == 0) {
        g = g + 1 < groups_.size() ? g + 1 : 0;
        group = groups_[g];
      }
    }
    const size_t other = g * 64 + static_cast<size_t>(std::countr_zero(group));
    const uint64_t choice = all_if(here != 0);
    const uint64_t bits = (here & choice) | (used_[other] & ~choice);
    const size_t word = (w & choice) | (other & ~choice);
    return word * 64 + static_cast<size_t>(std::countr_zero(bits));
  }

  // Clear a row that holds requests. Out: their indices until the next call, from the left; from
  // the right if from_right(), which is called only if there are several.
  template <class FromRight>
  std::span<const uint32_t> take_row(size_t place, FromRight from_right) {
    uint64_t& used = used_[place / 64];
    used &= ~(uint64_t{1} << (place % 64));
    groups_[place / 4096] &= ~(uint64_t{used == 0} << (place / 64 % 64));
    Row& row = rows_[place];
    uint32_t index = row.latest;
    const size_t count = row.count;
    row.count = 0;
    uint64_t* const bits = &pixels_[place * words_];
    uint32_t* const taken = taken_.data();
    taken[0] = index;
    if (count == 1) {
      const size_t column = static_cast<size_t>(chain_[index].column);
      bits[column / 64] &= ~(uint64_t{1} << (column % 64));
      return {taken, 1};
    }
    if (count <= FEW) {
      int32_t columns[FEW];
      uint32_t indices[FEW];
      std::fill_n(columns, FEW, std::numeric_limits<int32_t>::max());
      for (size_t i = 0; i < count; i++) {
        const size_t column = static_cast<size_t>(chain_[index].column);
        bits[column / 64] &= ~(uint64_t{1} << (column % 64));
        columns[i] = chain_[index].column;
        indices[i] = index;
        index = chain_[index].before;
      }
      const bool right = from_right();
      for (size_t i = 0; i < count; i++) {
        const size_t rank = rank_of(columns[i], columns);
        taken[right ? count - 1 - rank : rank] = indices[i];
      }
      return {taken, count};
    }
    // the bits give the order of many
    for (size_t i = 0; i < count; i++) {
      columns_[static_cast<size_t>(chain_[index].column)] = index;
      index = chain_[index].before;
    }
    size_t at = 0;
    for (size_t w = 0; w < words_; w++) {
      for (; bits[w]; bits[w] &= bits[w] - 1) {
        taken[at++] = columns_[w * 64 + static_cast<size_t>(std::countr_zero(bits[w]))];
      }
    }
    if (from_right()) std::reverse(taken, taken + count);
    return {taken, count};
  }

  // Call take(index) for all requests, row by row from the left, and clear them.
  template <class Take>
  void take_all(Take take) {
    for (size_t w = 0; w < used_.size(); w++) {
      while (used_[w]) {
        const size_t place = w * 64 + static_cast<size_t>(std::countr_zero(used_[w]));
        for (uint32_t index : take_row(place, [] { return false; })) take(index);
      }
    }
  }

 private:
  static constexpr size_t FEW = 8;

  struct Row {
    uint32_t latest;  // index of its latest request
    uint32_t count;
  };
  struct Latched {
    uint32_t before;  // index of the request of its row that came before
    int32_t column;
  };

  static uint64_t all_if(bool holds) { return uint64_t{0} - static_cast<uint64_t>(holds); }

  // How many of the columns are left of one.
  static size_t rank_of(int32_t column, const int32_t (&columns)[FEW]) {
    int32_t rank = 0;
    for (int32_t other : columns) rank += other < column;
    return static_cast<size_t>(rank);
  }

  size_t width_;
  size_t height_;
  size_t words_;                   // of the bits of a row
  std::vector<Row> rows_;          // (height,)
  std::vector<uint64_t> used_;     // a bit for each row
  std::vector<uint64_t> groups_;   // a bit for each word of used_
  std::vector<uint64_t> pixels_;   // (height, words), a bit for each pixel
  std::vector<Latched> chain_;     // of each request
  std::vector<uint32_t> columns_;  // scratch, (width,)
  std::vector<uint32_t> taken_;    // scratch, (width,)
};

}  // namespace evs
