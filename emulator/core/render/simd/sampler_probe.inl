// Entry points for the tests of sampling: draws and pdfs of the path integrator's samplers.
#pragma once

#include "render/integrators/sampler.inl"
#include "render/shading/light_sampling.inl"
#include "render/simd/sampler_probe_lanes.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Sample one dimension for 16 pixels. Out: x, y (16).
void probe_sampler(int mode, int seed, int log2_samples, int block, int log2_blocks, int index,
                   int dimension, const int* pixel, float* x, float* y) {
  Sampler sampler = {
      load(pixel), reverse_bits(splat(index)), mode, seed, log2_samples, block, log2_blocks, false};
  Point2 pair = sample_2d(sampler, dimension);
  store(x, pair.x);
  store(y, pair.y);
}

inline Bsdf probe_surface(const ProbeSurface& surface, Vec& d) {
  SurfaceInteraction<3> interaction = {};
  interaction.normal = splat(V3{0, 0, 1});
  for (int c = 0; c < 3; c++) {
    interaction.albedo[c] = splat(surface.albedo[c]);
    interaction.f0[c] = splat(surface.f0[c]);
  }
  interaction.metallic = splat(surface.metallic);
  interaction.physical = mask_from_bits(ALL_LANES);
  interaction.alpha_ggx = splat(surface.alpha);
  interaction.reflectance = splat(surface.mirror);
  d = splat(V3{-surface.eye[0], -surface.eye[1], -surface.eye[2]});
  return make_bsdf(interaction, d, 1, nullptr);
}

inline void probe_store(ProbeLanes& out, Vec direction, const Float* light, Float pdf) {
  store(out.direction[0], direction.x);
  store(out.direction[1], direction.y);
  store(out.direction[2], direction.z);
  for (int c = 0; c < 3; c++) store(out.value[c], light[c]);
  store(out.pdf, pdf);
}

// Sample directions from a BSDF. In: u (4, 16) random numbers.
void probe_bsdf_sample(const ProbeSurface& surface, const float* u, ProbeLanes& out) {
  Vec d;
  Bsdf s = probe_surface(surface, d);
  Point2 u_choice = {load(u), load(u + LANES)};
  Point2 point = {load(u + 2 * LANES), load(u + 3 * LANES)};
  BsdfSample drawn = sample_bsdf(s, d, u_choice, point);
  probe_store(out, drawn.direction, drawn.weight, drawn.pdf);
  store(out.pdf_evaluated, evaluate_bsdf(s, d, drawn.direction).pdf);
  store(out.specular, select(drawn.specular, splat(1), splat(0)));
  store(out.alive, select(drawn.alive, splat(1), splat(0)));
}

// Evaluate f cos and the pdf of directions. In: out.direction.
void probe_bsdf(const ProbeSurface& surface, ProbeLanes& out) {
  Vec d, w = {load(out.direction[0]), load(out.direction[1]), load(out.direction[2])};
  Bsdf s = probe_surface(surface, d);
  BsdfValue v = evaluate_bsdf(s, d, w);
  probe_store(out, w, v.f_cos, v.pdf);
}

// Evaluate the light-sampling pdf of what a BSDF-sampled ray hits. In: the ray's origin, camera
// frame; out.direction. Out: out.pdf_evaluated.
void probe_light_pdf(const Frame& f, const PathFrame& p, const float* point, ProbeLanes& out) {
  Mask all = mask_from_bits(0xffff);
  Vec w = {load(out.direction[0]), load(out.direction[1]), load(out.direction[2])};
  Rays rays = {splat(V3{point[0], point[1], point[2]}), w, false};
  Hit hit = intersect(f, rays, ray_cone(rays.origin, w, all, T_INFINITY), all, from(splat(0.0f)));
  Mask met = ~(hit.geom < splat(0));
  Float pdf = environment_pdf(p, environment_point(f, w));
  if (any(met)) {
    SurfaceInteraction<3> interaction =
        surface_interaction<3>(f, rays, hit, to_bits(met), splat(0.0f));
    pdf = select(met, emitter_pdf(f, p, rays, hit, interaction, to_bits(met)), pdf);
  }
  store(out.pdf_evaluated, pdf);
}

// Sample directions towards light. In: the shading point, camera frame; whether to sample the
// environment or the emitters; u (3, 16): the choice of the emitter, and the point on it.
void probe_light_sample(const Frame& f, const PathFrame& p, const float* point, bool environment,
                        const float* u, ProbeLanes& out) {
  Vec from = splat(V3{point[0], point[1], point[2]});
  Mask all = mask_from_bits(0xffff);
  Point2 u_point = {load(u + LANES), load(u + 2 * LANES)};
  EnvironmentPoint at;
  LightSample light_sample = environment
                                 ? sample_environment(f, p, u_point, at)
                                 : sample_emitter(f, p, from, load(u), u_point, all, splat(0.0f));
  if (environment)
    environment_radiance(f, p, at, splat(T_INFINITY), mask_from_bits(0), splat(1.0f), 0xffff,
                         light_sample.light);
  probe_store(out, light_sample.wi, light_sample.light, light_sample.pdf);
  probe_light_pdf(f, p, point, out);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
