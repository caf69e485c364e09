// First points of samples that lamps light anew: what is seen there is kept from tick to tick, so
// that neither the ray nor the texture is asked again.
#pragma once

#include "integrators/wavefront.inl"

namespace evs::EVS_SPACE {
namespace {

constexpr float UNKNOWN = -1;               // in place of the distance
constexpr int NOT_KEPT = -2, NOTHING = -1;  // in place of the geom

// A shape whose normals and numbers follow from the point, all but the texture's colour?
EVS_INLINE bool is_plain(const Frame& f, int index) {
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  return g.shape != MESH && g.shape != HFIELD && !s.layered && s.normal_map < 0;
}

// What the first rays of `active` meet: `geom`, where not NOTHING; the other lanes keep what they
// have.
inline void keep_points(const Frame& f, const KeptLight& kept, long at, const Rays& rays,
                        const Hit& hit, const Patch<3>& patch, Mask active, Mask lit) {
  int geom = NOTHING;
  for (unsigned lanes = bits(lit); lanes && geom < 0;) {
    int index = lane(hit.geom, first_lane(lanes));
    if (is_plain(f, index)) geom = index;
    lanes &= ~bits(hit.geom == splat(index));
  }
  int32_t& seen = kept.seen[at / LANES];
  Mask here = lit & (hit.geom == splat(geom));
  Float away = select(here, hit.distance, select(lit, splat(UNKNOWN), splat(FAR)));
  Float before = seen == geom ? load(kept.away + at) : splat(UNKNOWN);
  away = select(active, away, before);
  store(kept.away + at, away);
  seen = geom;
  kept.unlit[at / LANES] = 0;
  Mask known = ~(away < 0.0f) & (away < FAR);
  Region points = region_of(rays.origin + rays.direction * away, 0.0f, known);
  Hull ball = ball_of(points);
  float parts[4] = {ball.center.x, ball.center.y, ball.center.z, ball.radius};
  for (int i = 0; i < 4; i++) kept.ball[i][at / LANES] = parts[i];
  if (geom < 0 || f.surfaces[f.geoms[geom].surface].texture < 0) return;
  Int places = splat(static_cast<int>(at)) + load(LANE);
  for (int c = 0; c < 3; c++) store_at(kept.albedo[c], places, patch.albedo[c], here);
}

// The same patch as patch_of, of a plain shape. In: albedo, for a texture.
inline void plain_patch(const Frame& f, int index, const Rays& rays, const Hit& hit,
                        float* const* albedo, long at, Patch<3>& patch) {
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  Vec normal = {splat(0.0f), splat(0.0f), splat(1.0f)};
  if (g.shape != PLANE) normal = site_of(f, g, rays, hit, ALL_LANES).normal;
  patch.point = patch.origin = rays.origin + rays.direction * hit.distance;
  patch.flat = to_camera(g.rotation, normal);
  patch.normal = facing(patch.flat, rays.direction);
  patch.reflectance = mirror_share(g, s, normal, to_local(g.rotation, rays.direction));
  patch.alpha_ggx = splat(s.alpha_ggx);
  patch.metallic = splat(s.physical ? s.metallic : 0.0f);
  for (int c = 0; c < 3; c++) {
    patch.albedo[c] = s.texture >= 0 ? load(albedo[c] + at) : splat(s.albedo[c]);
    patch.emitted[c] = patch.albedo[c] * s.emission;
    patch.f0[c] = splat(s.f0);
    if (s.physical) patch.f0[c] = 0.04f + (patch.albedo[c] - 0.04f) * patch.metallic;
  }
}

// Brings what relight_unit will read near. More than a dozen arrays at once are too many for the
// processor to foresee.
EVS_INLINE void bring_near(const KeptLight& kept, long at) {
  auto bring = [at](const float* array) {
    for (int i = 0; i < LANES; i += 16) __builtin_prefetch(array + at + i);
  };
  for (const float* array : kept.rest) bring(array);
  if (!kept.seen) return;
  bring(kept.away);
  for (int c = 0; c < 3; c++) bring(kept.albedo[c]), bring(kept.light[c]);
}

// Of packets side by side from the `first` on: those whose points lights that are not steady may
// reach, one bit each.
inline unsigned reached_packets(const Frame& f, const KeptLight& kept, long first, int count) {
  if (!kept.seen) return ALL_LANES;
  alignas(64) float parts[4][LANES] = {};
  for (int i = 0; i < 4; i++) {
    __builtin_memcpy(parts[i], kept.ball[i] + first, static_cast<size_t>(count) * sizeof(float));
  }
  Balls balls = {{load(parts[0]), load(parts[1]), load(parts[2])}, load(parts[3])};
  Mask found = mask_of(0);
  for (int i = 0; i < f.light_count; i++) {
    bool steady = f.lights[i].kind == IMAGE || (i < 32 && kept.steady >> i & 1);
    if (!steady) found = found | in_reach(f.lights[i], balls);
  }
  return bits(found);
}

// The units `unit` of `lanes` of pixels side by side, with MuJoCo's lights as they are now.
// `reached`: a light that is not steady may shine on one. False: all shine as they did.
inline bool relight_unit(const Frame& f, const PathFrame& p, const KeptLight& kept, int x, int y,
                         int unit, unsigned lanes, bool reached) {
  long at = (static_cast<long>(y) * kept.units + unit) * kept.columns + x;
  int seen = kept.seen ? kept.seen[at / LANES] : NOT_KEPT;
  Float zero = splat(0.0f), out[3] = {zero, zero, zero}, away = splat(UNKNOWN);
  if (seen != NOT_KEPT) away = load(kept.away + at);
  Mask active = mask_of(lanes), lit = active & (away < FAR);
  bool known = !any(active & (away < 0.0f));
  if (!any(lit) || (known && !reached && kept.unlit[at / LANES] && !kept.stirred)) return false;
  Walk w;
  Vec direction = set_out(f, p, splat(x) + load(LANE), splat(y), splat(unit), active, w);
  Point point;
  bool shaded;
  if (!known) {
    lit = first_cast(f, p, w, nullptr, active, nullptr, out);
    shaded = any(lit) && arrive(f, p, 0, w, lit, nullptr, nullptr, point, out);
    if (kept.seen) keep_points(f, kept, at, w.rays, w.hit, point.patch, active, lit);
  } else {
    kept.unlit[at / LANES] = !reached;
    w.hit = {away, splat(seen), splat(0), zero, zero};
    if (p.sample_set == SAMPLES_ANCHORED) w.sampler.pixel = anchor_of(f, w.rays, w.hit, lit);
    plain_patch(f, seen, w.rays, w.hit, kept.albedo, at, point.patch);
    shaded = light_point(f, p, 0, w, lit, nullptr, nullptr, point, out);
    active = lit;  // what meets nothing shines as it did
  }
  for (int c = 0; c < 3; c++) {
    if (shaded) {
      Float received = point.received[c] + load(kept.rest[c] + at);
      out[c] = select(lit, out[c] + w.carried[c] * received, out[c]);
    }
    out[c] = out[c] + load(kept.rest[3 + c] + at);
  }
  add_air(f, direction, select(lit, w.hit.distance, splat(FAR)), out);
  for (int c = 0; c < 3; c++) {
    float* light = kept.light[c] + at;
    store(light, bits(active) == ALL_LANES ? out[c] : select(active, out[c], load(light)));
  }
  return true;
}

// The units of a packet of slots were traced: what is kept of their first points holds no longer
// where other points were met. In: owner, their places, -1 none.
inline void check_points(const KeptLight& kept, const PathBatch& b, int slot, Int owner) {
  Mask real = ~(owner < splat(0));
  Int place = select(real, owner, splat(0));
  constexpr int SHIFT = LANES == 32 ? 5 : 4;
  Float away = load(b.away + slot);
  Int seen = as_int(gather(reinterpret_cast<const float*>(kept.seen), shift_right<SHIFT>(place)));
  Mask same = (seen == load(b.seen + slot)) | ~(away < FAR);
  same = same & ~(away < gather(kept.away, place)) & ~(gather(kept.away, place) < away);
  store_at(kept.away, owner, splat(UNKNOWN), real & ~same);
  alignas(64) int places[LANES];
  store(places, owner);
  for (int i : places) {
    if (i >= 0) kept.unlit[i / LANES] = 0;
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
