// Events that their pixels hold until they are read: at most one a pixel, found by row.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

namespace evs {

// A bit a pixel and a bit a row; a pixel's value is the place of its request. Call clear first.
class HeldPixels {
 public:
  HeldPixels(int width, int height)
      : width_(static_cast<size_t>(width)),
        height_(static_cast<size_t>(height)),
        words_((width_ + 63) / 64) {}

  // Makes the memory and forgets whatever is held.
  void clear() {
    if (places_.empty()) {
      pixels_.assign(words_ * height_, 0);
      rows_.assign((height_ + 63) / 64, 0);
      places_.resize(width_ * height_);
    }
    take_all([](uint32_t) {});
  }

  // False where the pixel holds an event already.
  bool hold(int x, int y, uint32_t place) {
    const size_t column = static_cast<size_t>(x), row = static_cast<size_t>(y);
    uint64_t& word = pixels_[row * words_ + column / 64];
    const uint64_t bit = uint64_t{1} << (column % 64);
    if (word & bit) return false;
    word |= bit;
    rows_[row / 64] |= uint64_t{1} << (row % 64);
    places_[row * width_ + column] = place;
    return true;
  }

  // The first row after `row` that holds something, from the top again after the last; -1: none.
  int row_after(int64_t row) const {
    const int found = row_from(static_cast<size_t>(row + 1));
    return found >= 0 ? found : row_from(0);
  }

  // Calls take(place) for a row's pixels from the left, and forgets them.
  template <class Take>
  void take_row(size_t row, Take take) {
    rows_[row / 64] &= ~(uint64_t{1} << (row % 64));
    for (size_t w = 0; w < words_; w++) {
      uint64_t& word = pixels_[row * words_ + w];
      for (; word; word &= word - 1) {
        take(places_[row * width_ + w * 64 + static_cast<size_t>(std::countr_zero(word))]);
      }
    }
  }

  // Calls take(place) for every pixel, row by row, and forgets them.
  template <class Take>
  void take_all(Take take) {
    for (size_t w = 0; w < rows_.size(); w++) {
      while (rows_[w]) take_row(w * 64 + static_cast<size_t>(std::countr_zero(rows_[w])), take);
    }
  }

 private:
  int row_from(size_t row) const {
    for (size_t w = row / 64; w < rows_.size(); w++) {
      uint64_t word = rows_[w];
      if (w == row / 64) word &= ~uint64_t{0} << (row % 64);
      if (word) return static_cast<int>(w * 64 + static_cast<size_t>(std::countr_zero(word)));
    }
    return -1;
  }

  size_t width_;
  size_t height_;
  size_t words_;  // of a row
  std::vector<uint64_t> pixels_;
  std::vector<uint64_t> rows_;
  std::vector<uint32_t> places_;
};

}  // namespace evs
