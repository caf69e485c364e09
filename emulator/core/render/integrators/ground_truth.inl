// Ground truth: the first hit of the ray through each pixel's centre, without light.
#pragma once

#include "render/geometry/camera.inl"
#include "render/shading/surface_interaction.inl"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE void store(float (*out)[LANES], Vec v) {
  store(out[0], v.x);
  store(out[1], v.y);
  store(out[2], v.z);
}

// Return the normals of the hits of `lanes`: unit, in the camera's frame, facing the rays.
inline Vec shading_normal(const Frame& f, const Rays& rays, const Hit& hit, unsigned lanes) {
  Vec normal = splat(V3{0, 0, 0});
  while (lanes) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_from_bits(lanes);
    lanes &= ~to_bits(here);
    const Geom& g = f.geoms[index];
    normal = select(here, to_camera(g.rotation, local_hit(f, g, rays, hit, to_bits(here)).normal),
                    normal);
  }
  return face_forward(normal, rays.direction);
}

// Write the first hits of a packet whose upper left pixel is (x, y), as far as it has `columns` and
// `rows`.
inline void write_truth(const Frame& f, const Rays& rays, const Hit& hit, int x, int y, int columns,
                        int rows, const Truth& out) {
  // position and normal of the hits
  Mask missed = hit.geom < splat(0);
  Vec point = rays.origin + rays.direction * hit.distance, zero = splat(V3{0, 0, 0});
  Vec normal = select(missed, zero, shading_normal(f, rays, hit, to_bits(~missed)));
  point = select(missed, rays.direction, point);
  alignas(64) float at[3][LANES], n[3][LANES], distance[LANES], u[LANES], v[LANES];
  alignas(64) int geom[LANES], triangle[LANES];
  store(at, point);
  store(n, normal);
  store(distance, hit.distance);
  store(u, hit.u);
  store(v, hit.v);
  store(geom, hit.geom);
  store(triangle, hit.triangle);
  // write the pixels
  for (int j = 0; j < rows; j++) {
    for (int i = 0; i < columns; i++) {
      int l = j * PACKET_WIDTH + i;
      long pixel = static_cast<long>(y + j) * f.width + x + i;
      int shape = geom[l] < 0 ? -1 : f.geoms[geom[l]].shape;
      bool mesh = shape == MESH || shape == HFIELD;
      out.geom[pixel] = geom[l];
      out.distance[pixel] = geom[l] < 0 ? __builtin_inff() : distance[l];
      out.triangle[pixel] = mesh ? triangle[l] : -1;
      out.barycentric[2 * pixel] = mesh ? u[l] : 0.0f;
      out.barycentric[2 * pixel + 1] = mesh ? v[l] : 0.0f;
      for (int a = 0; a < 3; a++) {
        out.point[3 * pixel + a] = at[a][l];
        out.normal[3 * pixel + a] = n[a][l];
      }
    }
  }
}

// In: packet (column, row) of `f`. Out: its pixels of `out`.
inline void trace_truth(const Frame& f, int column, int row, const Truth& out) {
  // intersect the ray through each pixel's centre
  const RayCone& cone = f.primary[row * f.packet_columns + column];
  Rays rays = primary_rays(f, column, row, 0.5f, 0.5f);
  Hit hit =
      intersect(f, rays, cone, mask_from_bits(ALL_LANES), from(near_distance(f, rays.direction)));
  // write the pixels that lie in the image
  int x = column * PACKET_WIDTH, y = row * PACKET_HEIGHT;
  int columns = f.width - x < PACKET_WIDTH ? f.width - x : PACKET_WIDTH;
  int rows = f.height - y < PACKET_HEIGHT ? f.height - y : PACKET_HEIGHT;
  write_truth(f, rays, hit, x, y, columns, rows, out);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
