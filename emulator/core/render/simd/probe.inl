// The path integrator's samplers, number by number, for the tests of their densities.
#pragma once

#include "integrators/sampler.inl"
#include "shading/light_sampling.inl"
#include "simd/probe_lanes.h"

namespace evs::EVS_SPACE {
namespace {

// Points of one dimension and sample of 16 pixels. Out: x, y (16).
void probe_points(int mode, int seed, int digits, int index, int dimension, const int* pixel,
                  float* x, float* y) {
  Sampler sampler = {load(pixel), reverse_bits(splat(index)), mode, seed, digits};
  Pair pair = pair_of(sampler, dimension);
  store(x, pair.x);
  store(y, pair.y);
}

inline Scattering probe_surface(const ProbeSurface& surface, Vec& d) {
  Patch<3> patch = {};
  patch.normal = splat(V3{0, 0, 1});
  for (int c = 0; c < 3; c++) {
    patch.albedo[c] = splat(surface.albedo[c]);
    patch.f0[c] = splat(surface.f0[c]);
  }
  patch.metallic = splat(surface.metallic);
  patch.alpha_ggx = splat(surface.alpha);
  patch.reflectance = splat(surface.mirror);
  d = splat(V3{-surface.eye[0], -surface.eye[1], -surface.eye[2]});
  return scattering_of(patch, d);
}

inline void probe_store(ProbeLanes& out, Vec direction, const Float* light, Float density) {
  store(out.direction[0], direction.x);
  store(out.direction[1], direction.y);
  store(out.direction[2], direction.z);
  for (int c = 0; c < 3; c++) store(out.light[c], light[c]);
  store(out.density, density);
}

// Directions that a surface draws. In: numbers (4, 16).
void probe_scatter(const ProbeSurface& surface, const float* numbers, ProbeLanes& out) {
  Vec d;
  Scattering s = probe_surface(surface, d);
  Pair choice = {load(numbers), load(numbers + LANES)};
  Pair point = {load(numbers + 2 * LANES), load(numbers + 3 * LANES)};
  Scattered drawn = scatter(s, d, choice, point);
  probe_store(out, drawn.direction, drawn.throughput, drawn.density);
  store(out.again, evaluate(s, d, drawn.direction).density);
  store(out.mirrored, select(drawn.mirrored, splat(1), splat(0)));
  store(out.alive, select(drawn.alive, splat(1), splat(0)));
}

// f times cosine and density of directions. In: out.direction.
void probe_evaluate(const ProbeSurface& surface, ProbeLanes& out) {
  Vec d, w = {load(out.direction[0]), load(out.direction[1]), load(out.direction[2])};
  Scattering s = probe_surface(surface, d);
  Value v = evaluate(s, d, w);
  probe_store(out, w, v.light, v.density);
}

// The density that a ray is told which finds by chance what could have been aimed at. In: the point
// it leaves, camera frame; out.direction. Out: out.again.
void probe_told(const Frame& f, const PathFrame& p, const float* point, ProbeLanes& out) {
  Mask all = mask_of(0xffff);
  Vec w = {load(out.direction[0]), load(out.direction[1]), load(out.direction[2])};
  Rays rays = {splat(V3{point[0], point[1], point[2]}), w, false};
  Hit hit = closest(f, rays, hull_of(rays.origin, w, all, FAR), all, splat(0.0f));
  Mask met = ~(hit.geom < splat(0));
  Float told = sky_density(p, on_sky(f, w));
  if (any(met)) {
    Patch<3> patch = patch_of<3>(f, rays, hit, bits(met), splat(0.0f));
    told = select(met, density_of_hit(f, p, rays, hit, patch, bits(met)), told);
  }
  store(out.again, told);
}

// Directions of light that a point aims at. In: the point, camera frame; whether it aims at the sky
// or at glowing geoms; numbers (3, 16): the choice of a geom, and the place on it.
void probe_aim(const Frame& f, const PathFrame& p, const float* point, bool sky,
               const float* numbers, ProbeLanes& out) {
  Vec from = splat(V3{point[0], point[1], point[2]});
  Mask all = mask_of(0xffff);
  Pair place = {load(numbers + LANES), load(numbers + 2 * LANES)};
  SkyPlace at;
  Aim aim = sky ? aim_at_sky(f, p, place, at)
                : aim_at_emitter(f, p, from, load(numbers), place, all, splat(0.0f));
  if (sky) sky_light(f, p, at, splat(FAR), mask_of(0), 0xffff, aim.light);
  probe_store(out, aim.towards, aim.light, aim.density);
  probe_told(f, p, point, out);
}

}  // namespace
}  // namespace evs::EVS_SPACE
