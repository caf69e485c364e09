// Wavefront path tracing (after Laine, Karras & Aila 2013): all samples of a batch advance bounce
// by bounce, and the paths that hit something are compacted into full packets. A path's result does
// not depend on the other paths of its batch.
#pragma once

#include "render/geometry/camera.inl"
#include "render/integrators/film.inl"
#include "render/integrators/path.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int LANE[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                        16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

constexpr float PATH_CONTINUES =
    -1;  // in place of the indirect light: the path continues beyond its second vertex

// A batch in progress. Each sample has a slot; the slots of a packet are adjacent.
struct Wavefront {
  PathBatch& batch;
  const PathCacheView* cache;  // whose moving geoms' clearance is recorded, or null
  int slots = 0;
  int paths = 0;       // in the queue
  bool geoms = false;  // store the geoms of the first hits
};

// Append the paths of `alive` to the queue, from place `at` on.
inline void enqueue(Wavefront& front, int at, const PathState& path, Int slot, Mask alive) {
  int i = 0;
  auto put = [&](Float value) { compress(front.batch.paths[i++] + at, value, alive); };
  auto put_vector = [&](const Vec& v) { put(v.x), put(v.y), put(v.z); };
  put_vector(path.rays.origin);
  put_vector(path.rays.direction);
  put(path.hit.distance);
  put(as_float(path.hit.geom));
  put(as_float(path.hit.triangle));
  put(path.hit.u);
  put(path.hit.v);
  for (Float share : path.throughput) put(share);
  put(path.path_length);
  put(path.pdf);
  put(select(path.specular_bounce, splat(1.0f), splat(0.0f)));
  put(as_float(path.sampler.pixel));
  put(as_float(path.sampler.reversed_index));
  put(as_float(slot));
}

// Read the paths from place `at` of the queue. Out: their slots.
inline Int dequeue(const Wavefront& front, const PathFrame& p, int at, PathState& path) {
  int i = 0;
  auto get = [&] { return load(front.batch.paths[i++] + at); };
  auto get_int = [&] { return as_int(get()); };
  path.rays.common = path.rays.primary = false;
  auto get_vector = [&](Vec& v) { v.x = get(), v.y = get(), v.z = get(); };
  get_vector(path.rays.origin);
  get_vector(path.rays.direction);
  path.hit.distance = get();
  path.hit.geom = get_int();
  path.hit.triangle = get_int();
  path.hit.u = get();
  path.hit.v = get();
  for (Float& share : path.throughput) share = get();
  path.path_length = get();
  path.pdf = get();
  path.specular_bounce = get() > 0.0f;
  path.mirrored = splat(1.0f);
  path.sampler = {get_int(),      splat(0), p.sample_set,  p.seed,
                  p.log2_samples, p.block,  p.log2_blocks, p.quarters};
  path.sampler.reversed_index = get_int();
  return get_int();
}

// Start paths through the pixels. Out: the directions of the camera rays.
inline Vec generate_camera_rays(const Frame& f, const PathFrame& p, Int column, Int row, Int index,
                                Mask active, PathState& path) {
  path.sampler = {row * splat(f.width) + column,
                  reverse_bits(index + splat(p.first_sample)),
                  p.sample_set,
                  p.seed,
                  p.log2_samples,
                  p.block,
                  p.log2_blocks,
                  p.quarters};
  Point2 in_pixel = sample_2d(path.sampler, DIM_PIXEL);
  path.rays = rays_through(f, to_float(column) + in_pixel.x, to_float(row) + in_pixel.y);
  for (Float& share : path.throughput) share = splat(1.0f);
  path.path_length = path.pdf = splat(0.0f);
  path.mirrored = splat(1.0f);
  path.specular_bounce = active;
  return path.rays.direction;
}

// Intersect the camera rays. Out: the lanes to shade.
inline Mask intersect_camera_rays(const Frame& f, const PathFrame& p, PathState& path,
                                  const RayCone* cone, Mask active, Clearance* clearance,
                                  Float* out) {
  RayCone own = cone ? *cone : ray_cone(path.rays.origin, path.rays.direction, active, T_INFINITY);
  Mask lit = intersect_paths(f, p, 0, path, own, splat(-1), active, clearance, out);
  if (path.sampler.mode == SAMPLES_ANCHORED)
    path.sampler.pixel = surface_anchor(f, path.rays, path.hit, lit);
  return lit;
}

// Store the rays of complete paths, except those that are traced in the next tick anyway.
// `hit_distance`: of the first hits.
inline void store_secondary_rays(PathBatch& b, int slot, Vec point, Float hit_distance,
                                 const SecondaryRays& secondary, Float gap, Mask alive) {
  Mask whole = secondary.complete & ~alive & (gap >= 0.0f);
  store(b.secondary_rays[3] + slot, select(whole, hit_distance, splat(-1.0f)));
  if (!any(whole)) return;
  store(b.secondary_rays[0] + slot, point.x);
  store(b.secondary_rays[1] + slot, point.y);
  store(b.secondary_rays[2] + slot, point.z);
  for (int i = 0; i < SECONDARY_RAYS; i++) {
    store(b.secondary_rays[4 + 4 * i] + slot, secondary.direction[i].x);
    store(b.secondary_rays[5 + 4 * i] + slot, secondary.direction[i].y);
    store(b.secondary_rays[6 + 4 * i] + slot, secondary.direction[i].z);
    store(b.secondary_rays[7 + 4 * i] + slot, secondary.t_max[i]);
  }
}

// Trace sample `index` of a packet of pixels up to the second hit. `cone` bounds the camera rays;
// null: scattered pixels.
inline void start_paths(const Frame& f, const PathFrame& p, Wavefront& front, Int column, Int row,
                        Int index, const RayCone* cone, Mask active) {
  PathBatch& b = front.batch;
  Float zero = splat(0.0f);
  // generate and intersect the camera rays
  PathState path;
  Vec direction = generate_camera_rays(f, p, column, row, index, active, path);
  Clearance recorded = {front.cache, splat(front.cache ? front.cache->max_gap : T_INFINITY),
                        splat(0), nullptr};
  Clearance* clearance = front.cache ? &recorded : nullptr;
  Clearance* lamp_clearance = clearance && front.cache->relight_lamps ? nullptr : clearance;
  Float out[3] = {zero, zero, zero}, sampled_light[3] = {zero, zero, zero},
        second_hit_light[3] = {zero, zero, zero};
  Mask lit = intersect_camera_rays(f, p, path, cone, active, clearance, out),
       alive = mask_from_bits(0);
  Float hit_distance = select(lit, path.hit.distance, splat(T_INFINITY));
  if (front.geoms) store(b.first_geom + front.slots, select(lit, path.hit.geom, splat(-1)));
  // hits on moving geoms are not cached
  if (lamp_clearance != clearance)
    store(b.hit_geom + front.slots, select(recorded.gap < 0.0f, splat(-2), path.hit.geom));
  SecondaryRays secondary;
  for (int i = 0; i < SECONDARY_RAYS; i++) {
    secondary.direction[i] = {zero, zero, zero};
    secondary.t_max[i] = zero;
  }
  secondary.complete = active;
  // shade the first hits and intersect the second rays
  if (any(lit)) {
    Int from_geom;
    if (clearance && front.cache->secondary_rays) recorded.secondary = &secondary;
    Mask continuing =
        shade_paths(f, p, 0, path, lit, clearance, lamp_clearance, from_geom, sampled_light, out);
    if (any(continuing)) {
      RayCone second_cone = ray_cone(path.rays.origin, path.rays.direction, continuing, T_INFINITY);
      alive = intersect_paths(f, p, 1, path, second_cone, from_geom, continuing, clearance,
                              second_hit_light);
      for (int c = 0; c < 3; c++) out[c] = out[c] + second_hit_light[c];
    }
  }
  // store the radiance, and what the path cache keeps of the sample
  int slot = front.slots;
  for (int c = 0; c < 3; c++) store(b.light[c] + slot, out[c]);
  if (f.medium.fog || f.medium.haze || clearance) store(b.hit_distance + slot, hit_distance);
  if (f.medium.haze) {
    store(b.direction[0] + slot, direction.x);
    store(b.direction[1] + slot, direction.y);
    store(b.direction[2] + slot, direction.z);
  }
  if (clearance) {
    store(b.gap + slot, recorded.gap);
    store(b.touched + slot, recorded.touched);
    for (int c = 0; c < 3; c++) {
      store(b.indirect[c] + slot, select(alive, splat(PATH_CONTINUES), sampled_light[c]));
      store(b.indirect[3 + c] + slot, second_hit_light[c]);
    }
    if (front.cache->secondary_rays)
      store_secondary_rays(b, slot, path.rays.origin, hit_distance, secondary, recorded.gap, alive);
  }
  // queue the paths that continue
  if (any(alive)) enqueue(front, front.paths, path, splat(slot) + load(LANE), alive);
  front.paths += __builtin_popcount(to_bits(alive));
  front.slots += LANES;
}

// Advance all paths of the batch until none is left.
inline void finish_paths(const Frame& f, const PathFrame& p, Wavefront& front) {
  PathBatch& b = front.batch;
  for (int bounce = 1; front.paths > 0; bounce++) {
    int next = 0;
    for (int at = 0; at < front.paths; at += LANES) {
      int count = front.paths - at < LANES ? front.paths - at : LANES;
      Mask lit = mask_from_bits(first_lanes(count)), alive = mask_from_bits(0);
      // load a packet of paths
      PathState path;
      Int slot = select(lit, dequeue(front, p, at, path), splat(0));
      Float out[3], sampled_light[3];
      for (int c = 0; c < 3; c++) out[c] = gather(b.light[c], slot);
      Clearance recorded = {front.cache, {}, {}, nullptr},
                *clearance = front.cache ? &recorded : nullptr;
      if (clearance) {
        recorded.gap = gather(b.gap, slot);
        recorded.touched = as_int(gather(reinterpret_cast<const float*>(b.touched), slot));
      }
      // shade their hits and intersect the next rays
      Int from_geom;
      Mask continuing =
          shade_paths(f, p, bounce, path, lit, clearance, clearance, from_geom, sampled_light, out);
      if (any(continuing)) {
        RayCone cone = ray_cone(path.rays.origin, path.rays.direction, continuing, T_INFINITY);
        alive =
            intersect_paths(f, p, bounce + 1, path, cone, from_geom, continuing, clearance, out);
      }
      // store the packet, and queue the paths that continue
      for (int c = 0; c < 3; c++) scatter(b.light[c], slot, out[c], lit);
      if (clearance) {
        scatter(b.gap, slot, recorded.gap, lit);
        scatter(reinterpret_cast<float*>(b.touched), slot, as_float(recorded.touched), lit);
      }
      if (any(alive)) enqueue(front, next, path, slot, alive);
      next += __builtin_popcount(to_bits(alive));
    }
    front.paths = next;
  }
}

// Apply fog and haze to light that comes from `hit_distance` along camera rays.
inline void apply_medium(const Frame& f, Vec direction, Float hit_distance, Float* light) {
  if (f.medium.fog) apply_fog<3>(f, hit_distance, light);
  if (!f.medium.haze) return;
  Float haze_distance, haze_alpha = haze(f, direction, haze_distance);
  Mask behind = hit_distance > haze_distance;
  Float haze_radiance[3];
  for (int c = 0; c < 3; c++) haze_radiance[c] = splat(f.medium.haze_color[c]);
  if (f.medium.fog) apply_fog<3>(f, haze_distance, haze_radiance);
  for (int c = 0; c < 3; c++) {
    light[c] = select(behind, light[c] + (haze_radiance[c] - light[c]) * haze_alpha, light[c]);
  }
}

// Load the radiance of a packet of slots.
inline void load_radiance(const Frame& f, const PathBatch& b, int slot, Float* light) {
  for (int c = 0; c < 3; c++) light[c] = load(b.light[c] + slot);
  Vec direction = {load(b.direction[0] + slot), load(b.direction[1] + slot),
                   load(b.direction[2] + slot)};
  apply_medium(f, direction, load(b.hit_distance + slot), light);
}

// Reduce the first geoms of a pixel's samples: add `geom` to those before it.
EVS_INLINE Int join_geoms(Int before, Int geom) {
  return select(before == geom, geom, splat(MIXED_GEOMS));
}

// Write the first geoms of a row of pixels that begins at (x, y), as far as it lies in the image.
inline void write_geoms(const Frame& f, int x, int y, Int geoms, int32_t* out) {
  alignas(64) int each[LANES];
  store(each, geoms);
  int end = f.width - x < LANES ? f.width - x : LANES;
  for (int i = 0; i < end; i++) out[static_cast<long>(y) * f.width + x + i] = each[i];
}

constexpr int SUM_BLOCK = 64;  // partial sums, so that thousands of samples do not lose precision
constexpr int BATCH_PACKETS = PathBatch::ROOM / LANES;

// Compute the mean over all samples of `count` packets of pixels. place(k, column, row) gives the
// k-th packet's pixels and the bounding cone of its rays, or null; done(k, mean, geoms) receives
// its mean, and the first geoms of its pixels if these are wanted.
template <class Place, class Done>
void trace_packets(const Frame& f, const PathFrame& p, PathBatch& batch, int count,
                   bool wants_geoms, const Place& place, const Done& done) {
  int chunk = f.samples < BATCH_PACKETS ? f.samples : BATCH_PACKETS;
  // batches of equal size
  int batches = (count * chunk + BATCH_PACKETS - 1) / BATCH_PACKETS;
  int most = BATCH_PACKETS / chunk, even = (count + batches - 1) / batches;
  int size = even < most ? even : most;
  for (int begin = 0; begin < count; begin += size) {
    int end = begin + size < count ? begin + size : count;
    // of the last packet: with more than one chunk there is only one
    Float sum[3], part[3];
    Int geoms = splat(-1);
    for (int first = 0; first < f.samples; first += chunk) {
      int last = first + chunk < f.samples ? first + chunk : f.samples;
      Wavefront front = {batch, nullptr};
      front.geoms = wants_geoms;
      for (int k = begin; k < end; k++) {
        Int column, row;
        const RayCone* cone = place(k, column, row);
        for (int s = first; s < last; s++) {
          start_paths(f, p, front, column, row, splat(s), cone, mask_from_bits(ALL_LANES));
        }
      }
      finish_paths(f, p, front);
      // add up the samples of each pixel
      for (int k = begin, slot = 0; k < end; k++) {
        for (int c = 0; c < 3 && first == 0; c++) sum[c] = part[c] = splat(0.0f);
        for (int s = first; s < last; s++, slot += LANES) {
          Float light[3];
          load_radiance(f, batch, slot, light);
          if (wants_geoms) {
            Int geom = load(batch.first_geom + slot);
            geoms = s == 0 ? geom : join_geoms(geoms, geom);
          }
          bool full = s % SUM_BLOCK == SUM_BLOCK - 1 || s == f.samples - 1;
          for (int c = 0; c < 3; c++) {
            part[c] = part[c] + light[c];
            if (full) {
              sum[c] = sum[c] + part[c];
              part[c] = splat(0.0f);
            }
          }
        }
        if (last < f.samples) continue;
        Float mean[3];
        for (int c = 0; c < 3; c++) mean[c] = sum[c] * (1.0f / static_cast<float>(f.samples));
        done(k, mean, geoms);
      }
    }
  }
}

inline void trace_path_row(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                           const Outputs& out) {
  int columns = f.packet_columns;
  auto place = [&](int k, Int& x, Int& y) -> const RayCone* {
    Int lane = load(LANE);
    x = (lane & splat(PACKET_WIDTH - 1)) + shift_right<4>(lane) * splat(PACKET_WIDTH) +
        splat(k * PACKETS * PACKET_WIDTH);
    y = (shift_right<2>(lane) & splat(PACKET_HEIGHT - 1)) + splat(row * PACKET_HEIGHT);
    if (PACKETS == 1) return &f.primary[row * columns + k];
    return f.pairs && 2 * k + 1 < columns ? &f.pairs[row * (columns / 2) + k] : nullptr;
  };
  int count = (columns + PACKETS - 1) / PACKETS;
  auto done = [&](int k, const Float* mean, Int geoms) {
    write_pixels<3>(f, k * PACKETS, row, luminance_of<3>(f, mean), mean, out);
    if (!out.geoms) return;
    alignas(64) int each[LANES];
    store(each, geoms);
    for (int i = 0; i < LANES; i++) {
      int x = (k * PACKETS + i / PACKET) * PACKET_WIDTH + i % PACKET_WIDTH;
      int y = row * PACKET_HEIGHT + i % PACKET / PACKET_WIDTH;
      if (x < f.width && y < f.height) out.geoms[static_cast<long>(y) * f.width + x] = each[i];
    }
  };
  trace_packets(f, p, batch, count, out.geoms != nullptr, place, done);
}

inline void trace_path_pixels(const Frame& f, const PathFrame& p, PathBatch& batch,
                              const int32_t* x, const int32_t* y, int count, float* luminance) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  auto place = [&](int, Int& x16, Int& y16) -> const RayCone* {
    x16 = load(column);
    y16 = load(row);
    return nullptr;
  };
  trace_packets(f, p, batch, 1, false, place, [&](int, const Float* mean, Int) {
    alignas(64) float out[LANES];
    store(out, luminance_of<3>(f, mean));
    for (int i = 0; i < count; i++) {
      luminance[i] = vignetted(f, static_cast<long>(row[i]) * f.width + column[i], out[i]);
    }
  });
}

// Trace the pixels of a row of packets whose bit in `marked` is set. Returns their number.
inline long trace_marked_row(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                             const uint32_t* marked, const Outputs& out) {
  // uncached paths leave these arrays of the batch free
  int32_t *x = batch.owner, *y = batch.touched;
  int words = (f.width + 31) / 32, top = row * PACKET_HEIGHT, count = 0;
  int bottom = top + PACKET_HEIGHT < f.height ? top + PACKET_HEIGHT : f.height;
  long traced = 0;
  auto place = [&](int k, Int& column, Int& line) -> const RayCone* {
    column = load(x + k * LANES);
    line = load(y + k * LANES);
    return nullptr;
  };
  auto done = [&](int k, const Float* mean, Int) {
    alignas(64) float grey[LANES], colour[3][LANES];
    store(grey, luminance_of<3>(f, mean));
    for (int c = 0; c < 3; c++) store(colour[c], mean[c]);
    for (int i = 0; i < LANES && k * LANES + i < count; i++) {
      long at = static_cast<long>(y[k * LANES + i]) * f.width + x[k * LANES + i];
      out.luminance[at] = vignetted(f, at, grey[i]);
      for (int c = 0; c < 3 && out.rgb; c++) out.rgb[3 * at + c] = vignetted(f, at, colour[c][i]);
    }
  };
  auto trace = [&] {
    if (count == 0) return;
    // unused lanes repeat the last pixel
    int packets = (count + LANES - 1) / LANES;
    for (int i = count; i < packets * LANES; i++) x[i] = x[count - 1], y[i] = y[count - 1];
    trace_packets(f, p, batch, packets, false, place, done);
    traced += count;
    count = 0;
  };
  // go packet by packet, so that the rays are coherent
  for (int first = 0; first < f.width; first += PACKET_WIDTH) {
    if (count + PACKET > PathBatch::ROOM) trace();
    for (int j = top; j < bottom; j++) {
      unsigned four = marked[static_cast<long>(j) * words + first / 32] >> first % 32 & 15u;
      for (; four; four &= four - 1) {
        x[count] = first + first_lane(four);
        y[count++] = j;
      }
    }
  }
  trace();
  return traced;
}

// The geoms that the samples of some pixels hit first.
inline void first_geoms(const Frame& f, const PathFrame& p, const int32_t* x, const int32_t* y,
                        int count, int32_t* geoms) {
  alignas(64) int column[LANES], row[LANES], each[LANES];
  fill_lanes(x, y, count, column, row);
  Mask active = mask_from_bits(ALL_LANES);
  Int all = splat(-1);
  for (int s = 0; s < f.samples; s++) {
    PathState path;
    Float ignored[3] = {splat(0.0f), splat(0.0f), splat(0.0f)};
    generate_camera_rays(f, p, load(column), load(row), splat(s), active, path);
    Mask lit = intersect_camera_rays(f, p, path, nullptr, active, nullptr, ignored);
    Int geom = select(lit, path.hit.geom, splat(-1));
    all = s == 0 ? geom : join_geoms(all, geom);
  }
  store(each, all);
  for (int i = 0; i < count; i++) geoms[i] = each[i];
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
