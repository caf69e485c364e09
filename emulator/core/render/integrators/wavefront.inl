// Wavefronts of paths (after Laine, Karras & Aila 2013): all samples of a batch are traced bounce
// by bounce, and those that hit something are gathered into full packets. What a path gives does
// not depend on which others it goes with.
#pragma once

#include "geometry/camera.inl"
#include "integrators/film.inl"
#include "integrators/path.inl"

namespace evs::EVS_SPACE {
namespace {

constexpr int LANE[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                        16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

EVS_INLINE unsigned first_lanes(int count) { return count < LANES ? (1u << count) - 1 : ALL_LANES; }

constexpr float LONGER = -1;  // in place of the rest: the path goes on behind its second point

// A batch on its way. Each sample has a slot; those of a packet lie side by side.
struct Wavefront {
  PathBatch& batch;
  const KeptLight* kept;  // whose rods the rays stay clear of, or null
  int slots = 0;
  int paths = 0;  // under way
};

// The paths of `alive` go on from the places behind those that do already.
inline void push(Wavefront& front, int at, const Walk& w, Int slot, Mask alive) {
  int i = 0;
  auto put = [&](Float value) { compress(front.batch.paths[i++] + at, value, alive); };
  auto put_vector = [&](const Vec& v) { put(v.x), put(v.y), put(v.z); };
  put_vector(w.rays.origin);
  put_vector(w.rays.direction);
  put(w.hit.distance);
  put(as_float(w.hit.geom));
  put(as_float(w.hit.triangle));
  put(w.hit.u);
  put(w.hit.v);
  for (Float share : w.carried) put(share);
  put(w.travelled);
  put(w.density);
  put(select(w.sure, splat(1.0f), splat(0.0f)));
  put(as_float(w.sampler.pixel));
  put(as_float(w.sampler.reversed));
  put(as_float(slot));
}

// Paths `at` ... of those under way. Out: their slots.
inline Int pull(const Wavefront& front, const PathFrame& p, int at, Walk& w) {
  int i = 0;
  auto get = [&] { return load(front.batch.paths[i++] + at); };
  auto get_int = [&] { return as_int(get()); };
  w.rays.common = w.rays.primary = false;
  auto get_vector = [&](Vec& v) { v.x = get(), v.y = get(), v.z = get(); };
  get_vector(w.rays.origin);
  get_vector(w.rays.direction);
  w.hit.distance = get();
  w.hit.geom = get_int();
  w.hit.triangle = get_int();
  w.hit.u = get();
  w.hit.v = get();
  for (Float& share : w.carried) share = get();
  w.travelled = get();
  w.density = get();
  w.sure = get() > 0.0f;
  w.sampler = {get_int(), splat(0), p.sample_set, p.seed, p.digits};
  w.sampler.reversed = get_int();
  return get_int();
}

// Paths of which nothing is known but their first ray, through the pixels. Out: its direction.
inline Vec set_out(const Frame& f, const PathFrame& p, Int column, Int row, Int index, Mask active,
                   Walk& w) {
  w.sampler = {row * splat(f.width) + column, reverse_bits(index), p.sample_set, p.seed, p.digits};
  Pair in_pixel = pair_of(w.sampler, DRAW_PIXEL);
  w.rays = rays_through(f, to_float(column) + in_pixel.x, to_float(row) + in_pixel.y);
  for (Float& share : w.carried) share = splat(1.0f);
  w.travelled = w.density = splat(0.0f);
  w.sure = active;
  return w.rays.direction;
}

// What the first rays meet. Out: lanes that are to be shaded.
inline Mask first_cast(const Frame& f, const PathFrame& p, Walk& w, const Hull* hull, Mask active,
                       Clearance* clearance, Float* out) {
  Hull own = hull ? *hull : hull_of(w.rays.origin, w.rays.direction, active, FAR);
  Mask lit = cast(f, p, 0, w, own, splat(-1), active, clearance, out);
  if (w.sampler.mode == SAMPLES_ANCHORED) w.sampler.pixel = anchor_of(f, w.rays, w.hit, lit);
  return lit;
}

// The rays of the slots of a packet, but for those that are traced in the next tick in any case.
// `away`: of the first points.
inline void keep_fan(PathBatch& b, int slot, Vec point, Float away, const Fan& fan, Float gap,
                     Mask alive) {
  Mask whole = fan.fits & ~alive & (gap >= 0.0f);
  store(b.fans[3] + slot, select(whole, away, splat(-1.0f)));
  if (!any(whole)) return;
  store(b.fans[0] + slot, point.x);
  store(b.fans[1] + slot, point.y);
  store(b.fans[2] + slot, point.z);
  for (int i = 0; i < FAN_RAYS; i++) {
    store(b.fans[4 + 4 * i] + slot, fan.towards[i].x);
    store(b.fans[5 + 4 * i] + slot, fan.towards[i].y);
    store(b.fans[6 + 4 * i] + slot, fan.towards[i].z);
    store(b.fans[7 + 4 * i] + slot, fan.limit[i]);
  }
}

// Sample `index` of a packet of pixels, those of `active`, up to where the paths' second rays end.
// `hull`: of the first rays; null: of pixels from anywhere.
inline void start_paths(const Frame& f, const PathFrame& p, Wavefront& front, Int column, Int row,
                        Int index, const Hull* hull, Mask active) {
  PathBatch& b = front.batch;
  Float zero = splat(0.0f);
  Walk w;
  Vec direction = set_out(f, p, column, row, index, active, w);
  Clearance known = {front.kept, splat(front.kept ? front.kept->reach : FAR), splat(0), nullptr};
  Clearance* clearance = front.kept ? &known : nullptr;
  Clearance* lamps = clearance && front.kept->relit ? nullptr : clearance;
  Float out[3] = {zero, zero, zero}, aimed[3] = {zero, zero, zero}, seen[3] = {zero, zero, zero};
  Mask lit = first_cast(f, p, w, hull, active, clearance, out), alive = mask_of(0);
  Float away = select(lit, w.hit.distance, splat(FAR));
  // what moves is not kept
  if (lamps != clearance)
    store(b.seen + front.slots, select(known.gap < 0.0f, splat(-2), w.hit.geom));
  Fan fan;
  for (int i = 0; i < FAN_RAYS; i++) {
    fan.towards[i] = {zero, zero, zero};
    fan.limit[i] = zero;
  }
  fan.fits = active;
  if (any(lit)) {
    Int left;
    if (clearance && front.kept->fans) known.fan = &fan;
    Mask going = shade(f, p, 0, w, lit, clearance, lamps, left, aimed, out);
    if (any(going)) {
      Hull second = hull_of(w.rays.origin, w.rays.direction, going, FAR);
      alive = cast(f, p, 1, w, second, left, going, clearance, seen);
      for (int c = 0; c < 3; c++) out[c] = out[c] + seen[c];
    }
  }
  int slot = front.slots;
  for (int c = 0; c < 3; c++) store(b.light[c] + slot, out[c]);
  if (f.air.fog || f.air.haze || clearance) store(b.away + slot, away);
  if (f.air.haze) {
    store(b.direction[0] + slot, direction.x);
    store(b.direction[1] + slot, direction.y);
    store(b.direction[2] + slot, direction.z);
  }
  if (clearance) {
    store(b.gap + slot, known.gap);
    store(b.touched + slot, known.touched);
    for (int c = 0; c < 3; c++) {
      store(b.rest[c] + slot, select(alive, splat(LONGER), aimed[c]));
      store(b.rest[3 + c] + slot, seen[c]);
    }
    if (front.kept->fans) keep_fan(b, slot, w.rays.origin, away, fan, known.gap, alive);
  }
  if (any(alive)) push(front, front.paths, w, splat(slot) + load(LANE), alive);
  front.paths += __builtin_popcount(bits(alive));
  front.slots += LANES;
}

// Every path to its end.
inline void finish_paths(const Frame& f, const PathFrame& p, Wavefront& front) {
  PathBatch& b = front.batch;
  for (int bounce = 1; front.paths > 0; bounce++) {
    int next = 0;
    for (int at = 0; at < front.paths; at += LANES) {
      int count = front.paths - at < LANES ? front.paths - at : LANES;
      Mask lit = mask_of(first_lanes(count)), alive = mask_of(0);
      Walk w;
      Int slot = select(lit, pull(front, p, at, w), splat(0));
      Float out[3], aimed[3];
      for (int c = 0; c < 3; c++) out[c] = gather(b.light[c], slot);
      Clearance known = {front.kept, {}, {}, nullptr}, *clearance = front.kept ? &known : nullptr;
      if (clearance) {
        known.gap = gather(b.gap, slot);
        known.touched = as_int(gather(reinterpret_cast<const float*>(b.touched), slot));
      }
      Int left;
      Mask going = shade(f, p, bounce, w, lit, clearance, clearance, left, aimed, out);
      if (any(going)) {
        Hull hull = hull_of(w.rays.origin, w.rays.direction, going, FAR);
        alive = cast(f, p, bounce + 1, w, hull, left, going, clearance, out);
      }
      for (int c = 0; c < 3; c++) store_at(b.light[c], slot, out[c], lit);
      if (clearance) {
        store_at(b.gap, slot, known.gap, lit);
        store_at(reinterpret_cast<float*>(b.touched), slot, as_float(known.touched), lit);
      }
      if (any(alive)) push(front, next, w, slot, alive);
      next += __builtin_popcount(bits(alive));
    }
    front.paths = next;
  }
}

// Light that comes from `away` along primary rays, behind the air in front of it.
inline void add_air(const Frame& f, Vec direction, Float away, Float* light) {
  if (f.air.fog) fog<3>(f, away, light);
  if (!f.air.haze) return;
  Float curtain, cover = haze(f, direction, curtain);
  Mask behind = away > curtain;
  Float veil[3];
  for (int c = 0; c < 3; c++) veil[c] = splat(f.air.haze_color[c]);
  if (f.air.fog) fog<3>(f, curtain, veil);
  for (int c = 0; c < 3; c++) {
    light[c] = select(behind, light[c] + (veil[c] - light[c]) * cover, light[c]);
  }
}

// The light of a packet of slots.
inline void take_light(const Frame& f, const PathBatch& b, int slot, Float* light) {
  for (int c = 0; c < 3; c++) light[c] = load(b.light[c] + slot);
  Vec direction = {load(b.direction[0] + slot), load(b.direction[1] + slot),
                   load(b.direction[2] + slot)};
  add_air(f, direction, load(b.away + slot), light);
}

constexpr int SUM_BLOCK = 64;  // sums of sums, so that thousands of samples do not round away
constexpr int BATCH_PACKETS = PathBatch::ROOM / LANES;

// Means of all samples of `count` packets of pixels. place(k, column, row) says which, and gives
// the hull of their first rays or null; done(k, mean) takes the k-th.
template <class Place, class Done>
void trace_packets(const Frame& f, const PathFrame& p, PathBatch& batch, int count,
                   const Place& place, const Done& done) {
  int chunk = f.samples < BATCH_PACKETS ? f.samples : BATCH_PACKETS;
  // batches of one size
  int batches = (count * chunk + BATCH_PACKETS - 1) / BATCH_PACKETS;
  int most = BATCH_PACKETS / chunk, even = (count + batches - 1) / batches;
  int size = even < most ? even : most;
  for (int begin = 0; begin < count; begin += size) {
    int end = begin + size < count ? begin + size : count;
    Float sum[3], part[3];  // of the last packet: where there are more chunks, there is one
    for (int first = 0; first < f.samples; first += chunk) {
      int last = first + chunk < f.samples ? first + chunk : f.samples;
      Wavefront front = {batch, nullptr};
      for (int k = begin; k < end; k++) {
        Int column, row;
        const Hull* hull = place(k, column, row);
        for (int s = first; s < last; s++) {
          start_paths(f, p, front, column, row, splat(s), hull, mask_of(ALL_LANES));
        }
      }
      finish_paths(f, p, front);
      for (int k = begin, slot = 0; k < end; k++) {
        for (int c = 0; c < 3 && first == 0; c++) sum[c] = part[c] = splat(0.0f);
        for (int s = first; s < last; s++, slot += LANES) {
          Float light[3];
          take_light(f, batch, slot, light);
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
        done(k, mean);
      }
    }
  }
}

inline void trace_path_row(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                           const Outputs& out) {
  int columns = f.packet_columns;
  auto place = [&](int k, Int& x, Int& y) -> const Hull* {
    Int lane = load(LANE);
    x = (lane & splat(PACKET_WIDTH - 1)) + shift_right<4>(lane) * splat(PACKET_WIDTH) +
        splat(k * PACKETS * PACKET_WIDTH);
    y = (shift_right<2>(lane) & splat(PACKET_HEIGHT - 1)) + splat(row * PACKET_HEIGHT);
    if (PACKETS == 1) return &f.primary[row * columns + k];
    return f.pairs && 2 * k + 1 < columns ? &f.pairs[row * (columns / 2) + k] : nullptr;
  };
  int count = (columns + PACKETS - 1) / PACKETS;
  trace_packets(f, p, batch, count, place, [&](int k, const Float* mean) {
    write_pixels<3>(f, k * PACKETS, row, luminance_of<3>(f, mean), mean, out);
  });
}

inline void trace_path_pixels(const Frame& f, const PathFrame& p, PathBatch& batch,
                              const int32_t* x, const int32_t* y, int count, float* luminance) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  auto place = [&](int, Int& x16, Int& y16) -> const Hull* {
    x16 = load(column);
    y16 = load(row);
    return nullptr;
  };
  trace_packets(f, p, batch, 1, place, [&](int, const Float* mean) {
    alignas(64) float out[LANES];
    store(out, luminance_of<3>(f, mean));
    for (int i = 0; i < count; i++) {
      luminance[i] = shaded(f, static_cast<long>(row[i]) * f.width + column[i], out[i]);
    }
  });
}

}  // namespace
}  // namespace evs::EVS_SPACE
