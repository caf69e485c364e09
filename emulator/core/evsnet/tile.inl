// Load and store the 16 pixels of a tile.
#pragma once

#include "base/simd.inl"
#include "evsnet/network_kernel.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Lanes outside the image copy its edge; their values never leave the kernel.
template <class T>
EVS_INLINE void load_tile(T* lanes, const T* image, const TilePlace& place) {
  const T* from = image + place.pixel;
  if (place.whole()) {
    for (int row = 0; row < kTileSide; row++) {
      __builtin_memcpy(lanes + kTileSide * row, from + static_cast<size_t>(row) * place.width,
                       sizeof(T) * kTileSide);
    }
    return;
  }
  for (int i = 0; i < kLanes; i++) {
    const int row = i / kTileSide < place.rows ? i / kTileSide : place.rows - 1;
    const int column = i % kTileSide < place.columns ? i % kTileSide : place.columns - 1;
    lanes[i] = from[static_cast<size_t>(row) * place.width + static_cast<size_t>(column)];
  }
}

template <class T>
EVS_INLINE void store_tile(const T* lanes, T* image, const TilePlace& place) {
  T* to = image + place.pixel;
  for (int row = 0; row < place.rows; row++) {
    T* line = to + static_cast<size_t>(row) * place.width;
    if (place.columns == kTileSide) {
      __builtin_memcpy(line, lanes + kTileSide * row, sizeof(T) * kTileSide);
    } else {
      for (int column = 0; column < place.columns; column++)
        line[column] = lanes[kTileSide * row + column];
    }
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
