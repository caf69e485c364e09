// Camera rays: pinhole, orthographic, or a lens given as one direction at each pixel corner.
#pragma once

#include "render/geometry/outlines.inl"
#include "render/geometry/ray_cone.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Interpolate the direction at a point of the image (px) between the four corners of its pixel. The
// cone that bounds the corners therefore bounds every ray. Points outside the image are clamped to
// its edge.
EVS_INLINE Vec through_lens(const Frame& f, Float px, Float py) {
  Float x = min(max(px, splat(0.0f)), splat(static_cast<float>(f.width)));
  Float y = min(max(py, splat(0.0f)), splat(static_cast<float>(f.height)));
  Int column = truncate(min(x, splat(static_cast<float>(f.width - 1))));
  Int row = truncate(min(y, splat(static_cast<float>(f.height - 1))));
  Float u = x - to_float(column), v = y - to_float(row);
  int below = 3 * (f.width + 1);
  Int at = row * splat(below) + column * splat(3);
  auto corner = [&](int next) {
    const float* base = f.lens + next;
    return Vec{gather(base, at), gather(base + 1, at), gather(base + 2, at)};
  };
  Vec top = corner(0), bottom = corner(below);
  top = top + (corner(3) - top) * u;
  bottom = bottom + (corner(below + 3) - bottom) * u;
  return normalize(top + (bottom - top) * v);
}

// With 16 lanes a packet is 4 x 4 pixels; with 32 lanes two packets lie side by side. One lane goes
// pixel by pixel (simd/kernel_one_lane.cpp) and calls nothing that takes a packet.
constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT, PACKETS = LANES < PACKET ? 1 : LANES / PACKET;
struct PixelOfLane {
  float column[LANES], row[LANES];
  constexpr PixelOfLane() : column(), row() {
    for (int i = 0; i < LANES; i++) {
      column[i] = static_cast<float>(i / PACKET * PACKET_WIDTH + i % PACKET_WIDTH);
      row[i] = static_cast<float>(i % PACKET / PACKET_WIDTH);
    }
  }
};
constexpr PixelOfLane PIXEL;

// Generate the rays through these points of the image, in px.
EVS_INLINE Rays rays_through(const Frame& f, Float px, Float py) {
  Float zero = splat(0.0f), back = splat(-1.0f);
  if (f.lens) return {{zero, zero, zero}, through_lens(f, px, py), true, true};
  Float x = (px - f.cx) * (1.0f / f.fx), y = (f.cy - py) * (1.0f / f.fy);
  if (f.orthographic) return {{x, y, zero}, {zero, zero, back}, false, true};
  return {{zero, zero, zero}, normalize({x, y, back}), true, true};
}

// From a ray to the middle of its cell, of `cells` by `cells` in a pixel: sides of a cell. Zero
// where the samples lie in no such grid.
EVS_INLINE void to_middle(const Frame& f, const Rays& rays, int cells, Float& x, Float& y) {
  if (cells == 0) return;
  Vec d = rays.direction;
  // which pixel it is does not count
  Float cx = splat(f.cx), cy = splat(f.cy);
  cx = cx - floor(cx), cy = cy - floor(cy);
  Float column = cx + d.x / -d.z * f.fx, row = cy + d.y / d.z * f.fy;
  if (f.orthographic) column = cx + rays.origin.x * f.fx, row = cy - rays.origin.y * f.fy;
  column = column * static_cast<float>(cells);
  row = row * static_cast<float>(cells);
  x = floor(column) + 0.5f - column;
  y = row - floor(row) - 0.5f;
}

// What camera rays stand for, where outlines are blended.
EVS_INLINE CellRays cell_rays(const Frame& f, const Rays& rays) {
  CellRays cells = {rays.direction, rays.direction.z * -f.cell_x, rays.direction.z * -f.cell_y};
  if (f.cells > 1) {
    Float x, y;
    to_middle(f, rays, f.cells, x, y);
    cells.direction = normalize(cells.direction + Vec{cells.x * x, cells.y * y, splat(0.0f)});
  }
  return cells;
}

// The cone of single rays of the camera, and of what they stand for.
EVS_INLINE RayCone camera_cone(const Frame& f, const Rays& rays) {
  float square;
  Mask all = mask_from_bits(ALL_LANES);
  RayCone cone =
      ray_cone(bounding_box(rays.origin, 0.0f, all), rays.direction, all, T_INFINITY, square);
  if (f.outline_reach > 0) open_cone(cone, square, OUTLINE_ROOM * f.outline_reach);
  return cone;
}

// Where the rays of the camera begin: a near plane clips what is nearer, as in MuJoCo's pictures.
EVS_INLINE Float near_distance(const Frame& f, Vec direction) {
  if (f.near_sphere || f.near <= 0) return splat(f.near);
  return splat(f.near) / max(-direction.z, splat(1e-6f));
}

// Return the sample positions of pixels, rounded exactly as `primary_rays` rounds them.
EVS_INLINE Float pixel_point(const int* pixel, float sub, int packet) {
  alignas(64) float point[LANES];
  for (int i = 0; i < LANES; i++) {
    int within = pixel[i] % packet;
    point[i] = static_cast<float>(within) + (static_cast<float>(pixel[i] - within) + sub);
  }
  return load(point);
}

EVS_INLINE Rays primary_rays(const Frame& f, int column, int row, float sub_x, float sub_y) {
  // pixel indices are exact below 2^24, so each sum rounds once
  return rays_through(f, load(PIXEL.column) + (static_cast<float>(column * PACKET_WIDTH) + sub_x),
                      load(PIXEL.row) + (static_cast<float>(row * PACKET_HEIGHT) + sub_y));
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
