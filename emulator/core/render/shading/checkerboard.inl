// Tiled images (checkers, grids, one colour), averaged over what a camera ray stands for. A tile's
// weight is the product of its shares along u and along v, which is exact for a rectangle of the
// image; what a pixel covers is a parallelogram, so it is taken in four parts.
#pragma once

#include "render/geometry/camera.inl"
#include "render/shading/footprint.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Weights of the tiles of an image, which add up to 1.
struct TileWeights {
  Float of[MAX_TILES][MAX_TILES];

  EVS_INLINE void add(const Texture& t, const Float* across, const Float* down) {
    for (int i = 0; i < t.rows.count; i++) {
      for (int j = 0; j < t.columns.count; j++) of[i][j] = of[i][j] + down[i] * across[j];
    }
  }

  EVS_INLINE Float mean(const Texture& t, int channel) const {
    Float sum = splat(0.0f);
    for (int i = 0; i < t.rows.count; i++) {
      for (int j = 0; j < t.columns.count; j++) sum = sum + of[i][j] * t.tile[channel][i][j];
    }
    return sum;
  }
};

// What a camera ray stands for on an image: its sides (image lengths), and which share of the
// distance they come nearer.
struct ImageSides {
  Float xu, xv, yu, yv, nearing_x, nearing_y;
};

// By so much coverage may be wrong, image lengths: what lies within one tile is exactly that.
constexpr float ROUNDING = 1.0f / (1 << 21);

// The share that each tile of an axis has of an interval, which begins at `low` and is `width`
// long: image lengths. `inverse`: 1 / (width - 8 ROUNDING).
EVS_INLINE void tile_shares(const TileAxis& axis, Float low, Float width, Float inverse,
                            Float* share) {
  Float from = low - axis.start;
  from = from - floor(from);
  Float to = from + width, turns = floor(to), rest = splat(1.0f);
  to = to - turns;
  for (int k = 0; k + 1 < axis.count; k++) {
    auto covered = [&](Float x) {
      // the first tile begins at 0
      return min(k ? max(x - axis.offset[k], splat(0.0f)) : x, splat(axis.width[k]));
    };
    Float length = turns * axis.width[k] + (covered(to) - covered(from));
    share[k] = max(min((length - ROUNDING) * inverse, splat(1.0f)), splat(0.0f));
    rest = rest - share[k];
  }
  share[axis.count - 1] = max(rest, splat(0.0f));
}

// Find the tile that holds everything within `reach` of a point. Out: 1 for it, 0 for the others.
EVS_INLINE Mask find_tile(const TileAxis& axis, Float at, Float reach, Float* share) {
  Float from = at - reach - axis.start;
  from = from - floor(from);
  Float to = from + reach * 2.0f, all = splat(0.0f);
  for (int k = 0; k < axis.count; k++) {
    Mask holds = (from >= axis.offset[k]) & (to <= axis.offset[k] + axis.width[k]);
    share[k] = select(holds, splat(1.0f), splat(0.0f));
    all = all + share[k];
  }
  if (axis.count == 1) share[0] = all = splat(1.0f);
  return all > 0.5f;
}

// Parts of a pixel: their middles, in sides from the ray, and the squares of a part's sides.
struct PixelParts {
  int count;
  Float x[4], y[4], square_x, square_y;
  Float along;  // which side is split: -1, x, to 1, y
};

// Only a side that runs askew through the image has to be split. The pixel in four along x, two by
// two, four along y; between them the parts slide, with the variance of the whole.
EVS_INLINE PixelParts parts_of_pixel(const ImageSides& s) {
  Float of_x = abs(s.xu * s.xv), of_y = abs(s.yu * s.yv);
  PixelParts out;
  out.count = 4;
  Float along = out.along = (of_y - of_x) / max(of_x + of_y, splat(1e-20f));
  Float more_y = max(along, splat(0.0f)), more_x = max(-along, splat(0.0f));
  Float less_x = (1.0f - more_y) * 0.25f, less_y = (1.0f - more_x) * 0.25f;
  Float slide_x = more_x * 0.125f, slide_y = more_y * 0.125f;
  out.square_x = 1.0f - (less_x * less_x + slide_x * slide_x) * 12.0f;
  out.square_y = 1.0f - (less_y * less_y + slide_y * slide_y) * 12.0f;
  for (int k = 0; k < 4; k++) {
    float right = k & 1 ? 1.0f : -1.0f, upper = k & 2 ? 1.0f : -1.0f;
    out.x[k] = right * less_x + upper * slide_x;
    out.y[k] = upper * less_y + right * slide_y;
  }
  return out;
}

// The parts of one half of a pixel: it is cut across the side that is split more.
EVS_INLINE PixelParts half_of(const PixelParts& parts, float offset) {
  PixelParts out = parts;
  Mask of_y = parts.along > 0.0f;
  for (int k = 0; k < 4; k++) {
    out.x[k] = select(of_y, parts.x[k], parts.x[k] * 0.5f + offset);
    out.y[k] = select(of_y, parts.y[k] * 0.5f + offset, parts.y[k]);
  }
  out.square_x = select(of_y, parts.square_x, parts.square_x * 0.25f);
  out.square_y = select(of_y, parts.square_y * 0.25f, parts.square_y);
  return out;
}

// Add the tiles under some parts. In: the weight of a part.
EVS_INLINE void add_parts(const Texture& t, Float at_u, Float at_v, const ImageSides& s,
                          const PixelParts& parts, float weight, TileWeights& out) {
  constexpr float LEAST = 1.0f / 8192;  // image lengths; below it rounding would show
  // there the ray meets the tangent plane 1 / `depth` times as far
  Float depth[4], scale[4];
  for (int k = 0; k < parts.count; k++)
    depth[k] = 1.0f + parts.x[k] * s.nearing_x + parts.y[k] * s.nearing_y;
  if (parts.count == 4) {
    // four reciprocals by one division
    Float left = depth[0] * depth[1], right = depth[2] * depth[3], all = 1.0f / (left * right);
    Float of_left = all * right, of_right = all * left;
    scale[0] = of_left * depth[1], scale[1] = of_left * depth[0];
    scale[2] = of_right * depth[3], scale[3] = of_right * depth[2];
  } else {
    scale[0] = 1.0f / depth[0];
  }
  // as wide as a box of the same variance
  auto extent = [&](Float along_x, Float along_y) {
    Float square = along_x * along_x * parts.square_x + along_y * along_y * parts.square_y;
    return max(sqrt(square), splat(LEAST));
  };
  Float width = extent(s.xu, s.yu), height = extent(s.xv, s.yv);
  Float per_width = 1.0f / (width - 8 * ROUNDING), per_height = 1.0f / (height - 8 * ROUNDING);
  Float across[MAX_TILES], down[MAX_TILES];
  for (int k = 0; k < parts.count; k++) {
    Float u = at_u + (s.xu * parts.x[k] + s.yu * parts.y[k]) * scale[k];
    Float v = at_v + (s.xv * parts.x[k] + s.yv * parts.y[k]) * scale[k];
    Float larger = scale[k] * scale[k], smaller = depth[k] * depth[k];
    Float wide = width * larger, high = height * larger;
    tile_shares(t.columns, u - wide * 0.5f, wide, per_width * smaller, across);
    tile_shares(t.rows, v - high * 0.5f, high, per_height * smaller, down);
    for (int i = 0; parts.count > 1 && i < t.rows.count; i++) down[i] = down[i] * weight;
    out.add(t, across, down);
  }
}

// By how much less the parts of halves run askew than these: tiles, in width times height. The
// widest tile counts, since lines between tiles are a small share of a pixel.
EVS_INLINE Float gain_of_halves(const Texture& t, const ImageSides& s, const PixelParts& parts) {
  float width = 0, height = 0;
  for (int k = 0; k < t.columns.count; k++)
    width = t.columns.width[k] > width ? t.columns.width[k] : width;
  for (int k = 0; k < t.rows.count; k++)
    height = t.rows.width[k] > height ? t.rows.width[k] : height;
  // what does along x may make up for what does along y
  Float of_x = s.xu * s.xv * parts.square_x, of_y = s.yu * s.yv * parts.square_y;
  Mask cut_y = parts.along > 0.0f;
  Float half_x = select(cut_y, of_x, of_x * 0.25f), half_y = select(cut_y, of_y * 0.25f, of_y);
  return (abs(of_x + of_y) - abs(half_x + half_y)) * (1.0f / (width * height));
}

// Average the tiles of `lanes` over what their rays stand for. A ray for the whole pixel takes four
// parts of it, or of each half where it runs askew through several tiles; each of four rays
// takes one part (`quarter`). Of more rays each stands for its own cell.
[[gnu::noinline]] EVS_OUTLINE TileWeights blend_tiles(const Frame& f, const Rays& rays,
                                                      const Texture& t, Float at_u, Float at_v,
                                                      const ImageSides& s, bool quarter,
                                                      Mask lanes) {
  constexpr float FROM = 0.012f, TO = 0.024f;  // tiles
  TileWeights out = {};
  if (f.samples > 1) {
    PixelParts own;
    own.count = 1;
    own.x[0] = own.y[0] = splat(0.0f);
    own.square_x = own.square_y = splat(1.0f);
    if (!f.lens) to_middle(f, rays, quarter ? 1 : f.cells, own.x[0], own.y[0]);
    if (quarter) {
      // the part on the ray's side of the pixel's middle
      PixelParts parts = parts_of_pixel(s);
      Mask right = own.x[0] < 0.0f, upper = own.y[0] < 0.0f;
      auto of_side = [&](const Float* place) {
        return select(upper, select(right, place[3], place[2]), select(right, place[1], place[0]));
      };
      own = {1,
             {own.x[0] + of_side(parts.x)},
             {own.y[0] + of_side(parts.y)},
             parts.square_x,
             parts.square_y,
             parts.along};
    }
    add_parts(t, at_u, at_v, s, own, 1.0f, out);
    return out;
  }
  const PixelParts parts = parts_of_pixel(s);
  Float askew = (gain_of_halves(t, s, parts) - FROM) * (1.0f / (TO - FROM));
  askew = min(askew, abs(parts.along) * 2.0f);  // of sides that are alike neither is cut
  if (t.columns.count == 1 || t.rows.count == 1) askew = splat(0.0f);
  Mask few = ~(askew >= 1.0f), many = askew > 0.0f;  // a NaN: few
  if (any(few & lanes)) add_parts(t, at_u, at_v, s, parts, 0.25f, out);
  if (!any(many & lanes)) return out;
  TileWeights fine = {};
  add_parts(t, at_u, at_v, s, half_of(parts, -0.25f), 0.125f, fine);
  add_parts(t, at_u, at_v, s, half_of(parts, 0.25f), 0.125f, fine);
  for (int i = 0; i < t.rows.count; i++) {
    for (int j = 0; j < t.columns.count; j++) {
      Float blended = out.of[i][j] + (fine.of[i][j] - out.of[i][j]) * askew;
      out.of[i][j] = select(few, select(many, blended, out.of[i][j]), fine.of[i][j]);
    }
  }
  return out;
}

// Weigh the tiles of an image around the point u, v. In: the sides of a sample on it.
EVS_INLINE TileWeights tile_weights(const Frame& f, const Rays& rays, const Texture& t, Float u,
                                    Float v, const Float* side, const Footprint& footprint,
                                    Float distance, unsigned lanes) {
  const bool whole = f.samples == 1, quarter = f.cells == 2 && !f.lens && !whole;
  // the sides of the pixel, or of a sample's cell
  const float times = quarter ? 2.0f : whole && f.taps > 1 ? 1.0f / f.tap_width : 1.0f;
  Float nearness = f.orthographic ? splat(0.0f) : 1.0f / max(distance, splat(1e-6f));
  // at most: the horizon is never crossed half a side away
  auto nearing = [&](Float nearer) {
    return max(min(nearer * nearness * times, splat(0.9f)), splat(-0.9f));
  };
  const ImageSides s = {side[0] * times,
                        side[1] * times,
                        side[2] * times,
                        side[3] * times,
                        nearing(footprint.nearer_x),
                        nearing(footprint.nearer_y)};
  // Most pixels lie within one tile. Where less comes nearer, all grows by 1.18 at most, sides by
  // 1.4.
  const float reach = whole || f.lens ? 0.7f : 1.4f;
  Float across[MAX_TILES], down[MAX_TILES];
  Mask within = abs(s.nearing_x) + abs(s.nearing_y) < 0.3f;
  within = within & find_tile(t.columns, u, (abs(s.xu) + abs(s.yu)) * reach, across);
  within = within & find_tile(t.rows, v, (abs(s.xv) + abs(s.yv)) * reach, down);
  TileWeights out = {};
  out.add(t, across, down);
  if (!(~to_bits(within) & lanes)) return out;
  const TileWeights blended =
      blend_tiles(f, rays, t, u, v, s, quarter, mask_from_bits(lanes) & ~within);
  for (int i = 0; i < t.rows.count; i++) {
    for (int j = 0; j < t.columns.count; j++) {
      out.of[i][j] = select(within, out.of[i][j], blended.of[i][j]);
    }
  }
  return out;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
