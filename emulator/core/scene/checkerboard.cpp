#include "scene/checkerboard.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

namespace evs {
namespace {

// Viewers blend neighbouring texels. An axis with fewer is not tiled: there the blend is no small
// part of a tile.
constexpr int LEAST_TILED = 64;

// The lines between which an image is constant along one axis; `differs(i)`: is its row (or column)
// i another than the one before? An image repeats, so that a tile may go on beyond its end.
template <class Differs>
TileAxis find_tiles(int size, const Differs& differs) {
  TileAxis axis = {};
  int begin[MAX_TILES + 1] = {};
  for (int i = 0; i < size; i++) {
    if (!differs(i, i > 0 ? i - 1 : size - 1)) continue;
    if (axis.count == MAX_TILES || size < LEAST_TILED) return {};
    begin[axis.count++] = i;
  }
  axis.count = std::max(axis.count, 1);
  begin[axis.count] = begin[0] + size;
  auto lengths = [&](int texels) { return static_cast<float>(static_cast<double>(texels) / size); };
  axis.start = lengths(begin[0]);
  for (int k = 0; k < axis.count; k++) {
    axis.offset[k] = lengths(begin[k] - begin[0]);
    axis.width[k] = lengths(begin[k + 1] - begin[k]);
  }
  return axis;
}

}  // namespace

void find_tiles(const uint8_t* data, int height, int width, int components,
                const std::function<float(const uint8_t*, int)>& texel, Texture& t) {
  const size_t row = static_cast<size_t>(width) * components;
  TileAxis rows = find_tiles(height, [&](int i, int before) {
    return std::memcmp(data + i * row, data + before * row, row) != 0;
  });
  if (rows.count == 0) return;
  auto first = [](const TileAxis& axis, int size, int k) {
    return std::lround((axis.start + axis.offset[k]) * static_cast<double>(size)) % size;
  };
  TileAxis columns = find_tiles(width, [&](int i, int before) {
    for (int k = 0; k < rows.count; k++) {
      const uint8_t* line = data + first(rows, height, k) * row;
      if (std::memcmp(line + i * components, line + before * components, components)) return true;
    }
    return false;
  });
  if (columns.count == 0) return;
  t.rows = rows;
  t.columns = columns;
  for (int c = 0; c < t.channels; c++) {
    for (int i = 0; i < rows.count; i++) {
      for (int k = 0; k < columns.count; k++) {
        t.tile[c][i][k] =
            texel(data + first(rows, height, i) * row + first(columns, width, k) * components, c);
      }
    }
  }
}

}  // namespace evs
