// Cached first hits of samples whose lights change: their interactions are kept between ticks, so
// neither the camera ray nor the texture is evaluated again.
#pragma once

#include <cstddef>

#include "render/integrators/wavefront.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr float NOT_KNOWN = -1;               // in place of the distance
constexpr int NOT_CACHED = -2, NO_GEOM = -1;  // in place of the geom

// Is the shape's interaction determined by the hit point, except for a texture's colour?
EVS_INLINE bool is_cacheable(const Frame& f, int index) {
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  return g.shape != MESH && g.shape != HFIELD && !s.layered && s.normal_map < 0;
}

// Cache the first hits of `active`, if one cacheable geom covers them. The other lanes keep their
// entries.
inline void cache_hits(const Frame& f, const PathCacheView& cache, long at, const Rays& rays,
                       const Hit& hit, const SurfaceInteraction<3>& interaction, Mask active,
                       Mask lit) {
  // choose the geom: the first cacheable one
  int geom = NO_GEOM;
  for (unsigned lanes = to_bits(lit); lanes && geom < 0;) {
    int index = lane(hit.geom, first_lane(lanes));
    if (is_cacheable(f, index)) geom = index;
    lanes &= ~to_bits(hit.geom == splat(index));
  }
  // store the distances of its hits
  int32_t& hit_geom = cache.hit_geom[at / LANES];
  Mask here = lit & (hit.geom == splat(geom));
  Float hit_distance = select(here, hit.distance, select(lit, splat(NOT_KNOWN), splat(T_INFINITY)));
  Float before = hit_geom == geom ? load(cache.hit_distance + at) : splat(NOT_KNOWN);
  hit_distance = select(active, hit_distance, before);
  store(cache.hit_distance + at, hit_distance);
  hit_geom = geom;
  cache.only_steady_light[at / LANES] = 0;
  // bound the hits by a sphere
  Mask known = ~(hit_distance < 0.0f) & (hit_distance < T_INFINITY);
  BoundingBox points = bounding_box(rays.origin + rays.direction * hit_distance, 0.0f, known);
  RayCone sphere = bounding_sphere(points);
  float parts[4] = {sphere.center.x, sphere.center.y, sphere.center.z, sphere.radius};
  for (int i = 0; i < 4; i++) cache.sphere[i][at / LANES] = parts[i];
  // store the colour of a texture
  if (geom < 0 || f.surfaces[f.geoms[geom].surface].texture < 0) return;
  Int places = splat(static_cast<int>(at)) + load(LANE);
  for (int c = 0; c < 3; c++) scatter(cache.albedo[c], places, interaction.albedo[c], here);
}

// Rebuild the interaction that surface_interaction gives on a cacheable shape. In: albedo, for a
// texture.
inline void cached_interaction(const Frame& f, int index, const Rays& rays, const Hit& hit,
                               float* const* albedo, long at, SurfaceInteraction<3>& interaction) {
  const Geom& g = f.geoms[index];
  const Surface& s = f.surfaces[g.surface];
  Vec normal = {splat(0.0f), splat(0.0f), splat(1.0f)};
  if (g.shape != PLANE) normal = local_hit(f, g, rays, hit, ALL_LANES).normal;
  interaction.point = interaction.spawn_point = rays.origin + rays.direction * hit.distance;
  interaction.geometric_normal = to_camera(g.rotation, normal);
  interaction.normal = face_forward(interaction.geometric_normal, rays.direction);
  interaction.reflectance = mirror_reflectance(g, s, normal, to_local(g.rotation, rays.direction));
  interaction.alpha_ggx = splat(s.alpha_ggx);
  interaction.metallic = splat(s.physical ? s.metallic : 0.0f);
  interaction.physical = mask_from_bits(s.physical ? ALL_LANES : 0);
  for (int c = 0; c < 3; c++) {
    interaction.albedo[c] = s.texture >= 0 ? load(albedo[c] + at) : splat(s.albedo[c]);
    interaction.emitted[c] = interaction.albedo[c] * s.emission;
    interaction.f0[c] = s.texture >= 0 ? interaction.albedo[c] * s.f0 : splat(s.f0);
    if (s.physical)
      interaction.f0[c] = 0.04f + (interaction.albedo[c] - 0.04f) * interaction.metallic;
  }
}

// Prefetch what relight_unit reads: the hardware prefetcher cannot follow a dozen arrays at once.
EVS_INLINE void prefetch_unit(const PathCacheView& cache, long at) {
  auto prefetch = [at](const float* array) {
    for (int i = 0; i < LANES; i += 16) __builtin_prefetch(array + at + i);
  };
  for (const float* array : cache.indirect) prefetch(array);
  if (!cache.hit_geom) return;
  prefetch(cache.hit_distance);
  for (int c = 0; c < 3; c++) prefetch(cache.albedo[c]), prefetch(cache.light[c]);
}

// Find the packets from `first` on whose hits a changing light may reach, one bit each.
inline unsigned lit_packets(const Frame& f, const PathCacheView& cache, long first, int count) {
  if (!cache.hit_geom) return ALL_LANES;
  alignas(64) float parts[4][LANES] = {};
  for (int i = 0; i < 4; i++) {
    __builtin_memcpy(parts[i], cache.sphere[i] + first, static_cast<size_t>(count) * sizeof(float));
  }
  BoundingSpherePacket spheres = {{load(parts[0]), load(parts[1]), load(parts[2])}, load(parts[3])};
  Mask found = mask_from_bits(0);
  for (int i = 0; i < f.light_count; i++) {
    bool steady = f.lights[i].is_image() || (i < 32 && cache.steady >> i & 1);
    if (!steady) found = found | light_reaches(f.lights[i], spheres);
  }
  return to_bits(found);
}

// Relight the units `unit` of `lanes`, pixels side by side, with MuJoCo's current lights.
// `reached`: a changing light may reach them. False: their light is unchanged.
inline bool relight_unit(const Frame& f, const PathFrame& p, const PathCacheView& cache, int x,
                         int y, int unit, unsigned lanes, bool reached) {
  // skip units whose light cannot change
  long at = (static_cast<long>(y) * cache.units + unit) * cache.columns + x;
  int hit_geom = cache.hit_geom ? cache.hit_geom[at / LANES] : NOT_CACHED;
  Float zero = splat(0.0f), out[3] = {zero, zero, zero}, hit_distance = splat(NOT_KNOWN);
  if (hit_geom != NOT_CACHED) hit_distance = load(cache.hit_distance + at);
  Mask active = mask_from_bits(lanes), lit = active & (hit_distance < T_INFINITY);
  bool known = !any(active & (hit_distance < 0.0f));
  if (!any(lit) ||
      (known && !reached && cache.only_steady_light[at / LANES] && !cache.fewer_steady))
    return false;
  // shade the cached hits, or intersect the camera rays where there are none
  PathState path;
  Vec direction =
      generate_camera_rays(f, p, splat(x) + load(LANE), splat(y), splat(unit), active, path);
  ShadingPoint point;
  bool shaded;
  if (!known) {
    lit = intersect_camera_rays(f, p, path, nullptr, active, nullptr, out);
    shaded = any(lit) && reach_surface(f, p, 0, path, lit, nullptr, nullptr, point, out);
    if (cache.hit_geom)
      cache_hits(f, cache, at, path.rays, path.hit, point.interaction, active, lit);
  } else {
    cache.only_steady_light[at / LANES] = !reached;
    path.hit = {hit_distance, splat(hit_geom), splat(0), zero, zero};
    if (p.sample_set == SAMPLES_ANCHORED)
      path.sampler.pixel = surface_anchor(f, path.rays, path.hit, lit);
    cached_interaction(f, hit_geom, path.rays, path.hit, cache.albedo, at, point.interaction);
    shaded = direct_lighting(f, p, 0, path, lit, nullptr, nullptr, point, out);
    active = lit;  // what hits nothing keeps its light
  }
  // add the indirect light and apply the medium
  for (int c = 0; c < 3; c++) {
    if (shaded) {
      Float received = point.received[c] + load(cache.indirect[c] + at);
      out[c] = select(lit, out[c] + path.throughput[c] * received, out[c]);
    }
    out[c] = out[c] + load(cache.indirect[3 + c] + at);
  }
  apply_medium(f, direction, select(lit, path.hit.distance, splat(T_INFINITY)), out);
  // store the light
  for (int c = 0; c < 3; c++) {
    float* light = cache.light[c] + at;
    store(light, to_bits(active) == ALL_LANES ? out[c] : select(active, out[c], load(light)));
  }
  return true;
}

// Invalidate cached hits of a packet of slots that were traced and hit something else. In: owner,
// their entries, -1 none.
inline void validate_hits(const PathCacheView& cache, const PathBatch& b, int slot, Int owner) {
  Mask real = ~(owner < splat(0));
  Int place = select(real, owner, splat(0));
  constexpr int SHIFT = LANES == 32 ? 5 : 4;
  Float hit_distance = load(b.hit_distance + slot);
  Int hit_geom =
      as_int(gather(reinterpret_cast<const float*>(cache.hit_geom), shift_right<SHIFT>(place)));
  Mask same = (hit_geom == load(b.hit_geom + slot)) | ~(hit_distance < T_INFINITY);
  same = same & ~(hit_distance < gather(cache.hit_distance, place)) &
         ~(gather(cache.hit_distance, place) < hit_distance);
  scatter(cache.hit_distance, owner, splat(NOT_KNOWN), real & ~same);
  alignas(64) int places[LANES];
  store(places, owner);
  for (int i : places) {
    if (i >= 0) cache.only_steady_light[i / LANES] = 0;
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
