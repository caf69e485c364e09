// Contrast-adaptive antialiasing: the weight of each pixel's refinement, and the refined pixels.
//
// One sample a pixel suffices where the light without textures (the channel `untextured`) is linear
// over the neighbours: no edge, shadow boundary or highlight is near, and textures are already
// filtered over the pixel. The weight of a pixel rises while an edge is still outside it, where one
// sample and all samples agree, so nothing jumps when the edge moves in.
#pragma once

#include "render/geometry/pixel_pyramid.inl"
#include "render/integrators/direct.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr float CONTRAST_LOW = 0.04f,
                CONTRAST_HIGH = 0.12f;        // of the second difference, relative to the light
constexpr float CONTRAST_FLOOR = 1.0f / 255;  // luminance below which contrast fades: 1 DN

// Weigh by the second difference a - 2 b + c over opposite neighbours, in four directions. Where an
// outline is blended, which light below 0 marks, nothing is left to refine, there and across it. A
// NaN gives some weight.
inline void refinement_weight(const float* const* neighbours, float* weight) {
  Float own = load(neighbours[4]), centre = own * 2.0f, bend = splat(0.0f);
  for (int i = 0; i < 4; i++) {
    Float one = load(neighbours[i]), other = load(neighbours[8 - i]), sides = one + other;
    Float light = (sides + centre) * 0.25f + CONTRAST_FLOOR;
    Mask blended = (one < 0.0f) | (other < 0.0f);
    bend = select(blended, bend, max(bend, abs(sides - centre) / light));
  }
  Float w = (bend - CONTRAST_LOW) * (1.0f / (CONTRAST_HIGH - CONTRAST_LOW));
  store(weight, select(own < 0.0f, splat(0.0f), min(max(w, splat(0.0f)), splat(1.0f))));
}

// What a ray meets first.
struct FirstHit {
  int geom, triangle;
};

// Do two hits show one surface? Faces of a mesh are one where they are nearly parallel.
inline bool one_surface(const Frame& f, FirstHit a, FirstHit b) {
  constexpr float COSINE = 0.98f;
  if (a.geom != b.geom) return false;
  if (a.geom < 0 || f.geoms[a.geom].mesh < 0 || a.triangle == b.triangle) return true;
  const Triangle* triangles = f.meshes[f.geoms[a.geom].mesh].triangles;
  V3 n = triangles[a.triangle].normal, m = triangles[b.triangle].normal;
  return dot(n, m) >= COSINE * __builtin_sqrtf(dot(n, n)) * __builtin_sqrtf(dot(m, m));
}

// The hits of rays one by one.
struct WaitingHits {
  alignas(64) float distance[LANES], geom[LANES], triangle[LANES], u[LANES], v[LANES];

  void put(unsigned i, const Hit& hit, int from) {
    distance[i] = lane(hit.distance, from);
    geom[i] = lane(as_float(hit.geom), from);
    triangle[i] = lane(as_float(hit.triangle), from);
    u[i] = lane(hit.u, from);
    v[i] = lane(hit.v, from);
  }
  Hit all() const {
    return {load(distance), as_int(load(geom)), as_int(load(triangle)), load(u), load(v)};
  }
};

// Traces the light of pixels of a packet at edges. The rays of one pixel fill adjacent lanes,
// followed by those of the next pixel, and are summed one by one, so a pixel's light does not
// depend on the others.
template <int CHANNELS, class Shading>
struct EdgePixels {
  const Shading& shading;
  const Frame& f;
  int column, row;
  RayRecorder* recorder;
  float sum[PACKET] = {}, sums[PACKET][3] = {};  // weighed over the rays
  // the rays that wait: px
  unsigned used = 0;
  alignas(64) float x[LANES] = {}, y[LANES] = {};
  float weight[LANES] = {};
  int owner[LANES] = {};
  WaitingHits waiting = {};  // their hits, where these are known

  RayCone cone_of(const Rays& rays) const {
    return f.primary ? f.primary[row * f.packet_columns + column] : camera_cone(f, rays);
  }
  void add_ray(int pixel, float px, float py, float w) {
    const unsigned at = used % LANES;
    x[at] = px;
    y[at] = py;
    weight[at] = w;
    owner[at] = pixel;
    if (++used == LANES) trace_rays();
  }
  // Trace what waits.
  void trace_rays() {
    if (used == 0) return;
    // unused lanes repeat the last ray
    for (unsigned i = used; i < LANES; i++) x[i] = x[used - 1], y[i] = y[used - 1];
    Hit known;
    if (f.edge_x) known = waiting.all();
    trace(rays_through(f, load(x), load(y)), static_cast<int>(used), owner, weight,
          f.edge_x ? &known : nullptr);
    used = 0;
  }
  // Trace rays and add each to its pixel. In: their first hits, or null.
  void trace(const Rays& rays, int count, const int* pixels, const float* weights,
             const Hit* first) {
    alignas(64) float grey[LANES], colour[LANES];
    Float light[CHANNELS];
    radiance<CHANNELS, 0>(shading, f, rays, cone_of(rays), mask_from_bits((1u << count) - 1),
                          splat(0.0f), recorder, light, first);
    shading.template sampled<CHANNELS>(light);
    store(grey, luminance_of<CHANNELS>(f, light));
    for (int i = 0; i < count; i++) sum[pixels[i]] += grey[i] * weights[i];
    for (int c = 0; c < 3 && CHANNELS >= 3; c++) {
      store(colour, light[f.colour + c]);
      for (int i = 0; i < count; i++) sums[pixels[i]][c] += colour[i] * weights[i];
    }
  }

  void add_pixel(int pixel) {
    const float left = static_cast<float>(column * PACKET_WIDTH + pixel % PACKET_WIDTH),
                top = static_cast<float>(row * PACKET_HEIGHT + pixel / PACKET_WIDTH);
    // packets side by side are refined one by one
    if constexpr (LANES <= PACKET) {
      if (f.edge_x) return add_edges(pixel, left, top);
    }
    for (int s = 0; s < f.samples; s++)
      add_ray(pixel, left + f.sample_x[s], top + f.sample_y[s], 1.0f);
  }

  // Find what rays through points of a pixel meet first. In: the pixel's corner; points from there.
  template <int COUNT>
  void first_hits(float left, float top, const float* px, const float* py, Rays (&rays)[COUNT],
                  Hit (&hits)[COUNT], FirstHit* out) const {
    for (int i = 0; i < COUNT; i++)
      rays[i] = rays_through(f, load(px + i * LANES) + left, load(py + i * LANES) + top);
    if (LANES > 1 && COUNT > 1 && !f.lens && !f.orthographic) {
      intersect_pixel(f, pixel_pyramid(f, left, top), rays, hits);
    } else {
      for (int i = 0; i < COUNT; i++) {
        hits[i] = intersect(f, rays[i], cone_of(rays[i]), mask_from_bits(ALL_LANES),
                            from(near_distance(f, rays[i].direction)));
      }
    }
    for (int i = 0; i < COUNT * LANES; i++)
      out[i] = {lane(hits[i / LANES].geom, i % LANES), lane(hits[i / LANES].triangle, i % LANES)};
  }

  // Add a pixel that may show edges of meshes: where its samples meet several surfaces, more rays
  // find what each covers.
  void add_edges(int pixel, float left, float top) {
    constexpr int COUNT = PACKET / LANES;
    Rays rays[COUNT];
    Hit hits[COUNT];
    FirstHit first[PACKET];
    first_hits(left, top, f.sample_x, f.sample_y, rays, hits, first);
    for (int i = 1; i < PACKET; i++) {
      if (!one_surface(f, first[0], first[i])) return add_surfaces(pixel, left, top);
    }
    int owners[LANES];
    float weights[LANES];
    for (int i = 0; i < LANES; i++) owners[i] = pixel, weights[i] = 1.0f;
    for (int i = 0; i < COUNT; i++) trace(rays[i], LANES, owners, weights, hits + i);
  }
  // Add a pixel that shows several surfaces. In each of its cells each surface is lit once, on the
  // ray nearest to the middle of those that meet it.
  void add_surfaces(int pixel, float left, float top) {
    constexpr int IN_CELL = EDGE_RAYS / EDGE_CELLS, COUNT = EDGE_RAYS / LANES;
    const float share = static_cast<float>(PACKET) / EDGE_RAYS;
    Rays rays[COUNT];
    Hit all_hits[COUNT];
    FirstHit all[EDGE_RAYS];
    first_hits(left, top, f.edge_x, f.edge_y, rays, all_hits, all);
    for (int cell = 0; cell < EDGE_CELLS; cell++) {
      const float *cx = f.edge_x + cell * IN_CELL, *cy = f.edge_y + cell * IN_CELL;
      const FirstHit* first = all + cell * IN_CELL;
      for (unsigned rest = (1u << IN_CELL) - 1; rest;) {
        int begin = first_lane(rest), count = 0;
        unsigned group = 0;
        float middle_x = 0, middle_y = 0;
        for (unsigned left_over = rest; left_over; left_over &= left_over - 1) {
          int i = first_lane(left_over);
          if (i != begin && !one_surface(f, first[begin], first[i])) continue;
          group |= 1u << i;
          count++;
          middle_x += cx[i];
          middle_y += cy[i];
        }
        rest &= ~group;
        middle_x /= static_cast<float>(count);
        middle_y /= static_cast<float>(count);
        int nearest = begin;
        float least = 2;
        for (; group; group &= group - 1) {
          int i = first_lane(group);
          float dx = cx[i] - middle_x, dy = cy[i] - middle_y, square = dx * dx + dy * dy;
          if (square < least) least = square, nearest = i;
        }
        int at = cell * IN_CELL + nearest;
        waiting.put(used % LANES, all_hits[at / LANES], at % LANES);
        add_ray(pixel, left + cx[nearest], top + cy[nearest], share * static_cast<float>(count));
      }
    }
  }
};

// Trace all samples of some pixels.
template <int CHANNELS, class Shading>
void refine_packet(const Shading& shading, const Frame& f, int column, int row, unsigned pixels,
                   float* luminance, float* rgb, const PacketRecord* record) {
  RayRecorder recorder;
  if (record) static_cast<SecondaryRayBounds&>(recorder) = *record->secondary;
  EdgePixels<CHANNELS, Shading> edges = {shading, f, column, row, record ? &recorder : nullptr};
  for (unsigned left = pixels; left; left &= left - 1) edges.add_pixel(first_lane(left));
  edges.trace_rays();
  // record the rays, write the mean of each pixel
  if (record) write_record(recorder, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (unsigned left = pixels; left; left &= left - 1) {
    int pixel = first_lane(left);
    int x = column * PACKET_WIDTH + pixel % PACKET_WIDTH;
    int y = row * PACKET_HEIGHT + pixel / PACKET_WIDTH;
    long at = static_cast<long>(y) * f.width + x;
    luminance[pixel] = vignetted(f, at, edges.sum[pixel] * share);
    for (int c = 0; c < 3 && rgb; c++) {
      rgb[3 * pixel + c] = vignetted(f, at, edges.sums[pixel][c] * share);
    }
  }
}

// The same of one pixel. Returns its luminance.
template <int CHANNELS, class Shading>
float refined_pixel(const Shading& shading, const Frame& f, int x, int y) {
  float luminance[PACKET];
  int pixel = place_in_packet(x, y);
  refine_packet<CHANNELS>(shading, f, x / PACKET_WIDTH, y / PACKET_HEIGHT, 1u << pixel, luminance,
                          nullptr, nullptr);
  return luminance[pixel];
}

inline void refine(const Frame& f, int column, int row, unsigned pixels, float* luminance,
                   float* rgb, const PacketRecord* record) {
  switch (f.channels) {
    case 1:
      return refine_packet<1>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
    case 3:
      return refine_packet<3>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
    default:
      return refine_packet<4>(DirectShading{}, f, column, row, pixels, luminance, rgb, record);
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
