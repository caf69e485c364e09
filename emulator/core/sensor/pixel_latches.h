// Events that pixels hold until they are read: at most one a pixel, found by row.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace evs {

// A bit for each pixel and row, and for each pixel the index of its request. Call clear first.
class PixelLatches {
 public:
  PixelLatches(int width, int height)
      : width_(static_cast<size_t>(width)),
        height_(static_cast<size_t>(height)),
        words_((width_ + 63) / 64) {}

  // Allocate the memory and clear all latches.
  void clear() {
    if (requests_.empty()) {
      pixels_.assign(words_ * height_, 0);
      rows_.assign((height_ + 63) / 64, 0);
      requests_.resize(width_ * height_);
    }
    take_all([](uint32_t) {});
  }

  // Latch a request; false if the pixel holds one already.
  bool set(int x, int y, uint32_t index) {
    const size_t column = static_cast<size_t>(x), row = static_cast<size_t>(y);
    uint64_t& word = pixels_[row * words_ + column / 64];
    const uint64_t bit = uint64_t{1} << (column % 64);
    if (word & bit) return false;
    word |= bit;
    rows_[row / 64] |= uint64_t{1} << (row % 64);
    requests_[row * width_ + column] = index;
    return true;
  }

  // The next row after `row` with a request, wrapping around; -1 if there is none.
  int row_after(int64_t row) const {
    const int found = row_from(static_cast<size_t>(row + 1));
    return found >= 0 ? found : row_from(0);
  }

  // Call take(index) for the requests of a row from the left, and clear them.
  template <class Take>
  void take_row(size_t row, Take take) {
    rows_[row / 64] &= ~(uint64_t{1} << (row % 64));
    for (size_t w = 0; w < words_; w++) {
      uint64_t& word = pixels_[row * words_ + w];
      for (; word; word &= word - 1) {
        take(requests_[row * width_ + w * 64 + static_cast<size_t>(std::countr_zero(word))]);
      }
    }
  }

  // The same from the right.
  template <class Take>
  void take_row_from_right(size_t row, Take take) {
    rows_[row / 64] &= ~(uint64_t{1} << (row % 64));
    for (size_t w = words_; w-- > 0;) {
      uint64_t& word = pixels_[row * words_ + w];
      while (word) {
        const size_t bit = 63 - static_cast<size_t>(std::countl_zero(word));
        word ^= uint64_t{1} << bit;
        take(requests_[row * width_ + w * 64 + bit]);
      }
    }
  }

  // Call take(index) for all requests, row by row, and clear them.
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
  std::vector<uint32_t> requests_;
};

}  // namespace evs
