// The `path` integrator: unidirectional path tracing with next-event estimation.
//
// At each vertex:
//  1. Intersect the ray; add the environment's radiance where it misses.
//  2. Add the radiance that an emissive surface emits, weighted by multiple importance sampling
//  (balance heuristic) against light sampling.
//  3. Add MuJoCo's lights: all of them at the first vertex, one chosen at random later. No ray sees
//  their bulbs, so a bulb is sampled both directly and by the BSDF on the spot.
//  4. Sample a point on an emitter, or a direction of the environment, with the same weights.
//  5. Sample the BSDF and continue; from ROULETTE_START_DEPTH on, Russian roulette ends paths that
//  carry little.
#pragma once

#include "render/geometry/camera.inl"
#include "render/geometry/culling.inl"
#include "render/incremental/clearance.inl"
#include "render/integrators/sampler.inl"
#include "render/shading/environment.inl"
#include "render/shading/fog.inl"
#include "render/shading/light_sampling.inl"
#include "render/shading/lights.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Dimensions of the sampler at one vertex. Each light of the first vertex has one of its own after
// the last.
enum SampleDimension {
  DIM_PIXEL = 0,
  DIM_ROULETTE,
  DIM_BSDF_LOBE,
  DIM_BSDF_DIRECTION,
  DIM_LIGHT_SELECTION,
  DIM_LIGHT_POINT,
  DIM_LAMP
};
// of one vertex; the last ones belong to transparent layers
constexpr int DIMENSIONS_PER_VERTEX = 1 << 20;

constexpr int ROULETTE_START_DEPTH = 2;  // Russian roulette from this bounce on
// ... of paths whose throughput is below this. In a closed room of eight bounces, a quarter has
// less noise in a given number of rays than 1 or no roulette.
constexpr float ROULETTE_THROUGHPUT = 0.25f;

// The lanes of `lit` whose hit is on a transparent geom.
EVS_INLINE Mask on_transparent(const Frame& f, const Hit& hit, Mask lit) {
  Mask found = mask_from_bits(0);
  for (unsigned left = to_bits(lit); left;) {
    int index = lane(hit.geom, first_lane(left));
    Mask here = (hit.geom == splat(index)) & mask_from_bits(left);
    left &= ~to_bits(here);
    if (is_transparent(f, index)) found = found | here;
  }
  return found;
}

// Multiply the transparency of the layers that rays meet before `t_max`, from front to back. In:
// next(lanes, passed, layered) returns the nearest hits behind what is passed.
template <class Next>
Float through_layers(const Frame& f, const Rays& rays, Float t_max, Mask active, const Next& next) {
  Float zero = splat(0.0f), transmitted = select(active, splat(1.0f), zero);
  Passed passed = from(zero);
  for (int layer = 0; layer < MAX_LAYERS && any(active); layer++) {
    Hit hit = next(active, passed, layer > 0);
    active = active & (hit.distance < t_max) & ~(hit.geom < splat(0));
    Mask passing = on_transparent(f, hit, active);
    transmitted = select(active & ~passing, zero, transmitted);
    active = passing;
    if (!any(active)) return transmitted;
    SurfaceInteraction<3> interaction = surface_interaction<3>(f, rays, hit, to_bits(active), zero);
    transmitted = select(active, transmitted * max(1.0f - interaction.alpha, zero), transmitted);
    active = active & (transmitted > 0.0f);
    passed = through(f, hit, active);
  }
  return select(active, zero, transmitted);  // more layers than are followed: opaque
}

// The same through transparent geoms alone. `self` as of `occluded`.
inline Float through_geoms(const Frame& f, const PathFrame& p, const Rays& rays, Float t_max,
                           Int self, Mask active) {
  return through_layers(f, rays, t_max, active, [&](Mask left, const Passed& passed, bool layered) {
    Hit hit = no_hit(left);
    for (int i = 0; i < p.transparent_count; i++) {
      int index = p.transparent_geoms[i];
      Mask tested = lanes_to_test(f, index, self, left);
      if (!any(tested) || !any(rays_near(f, index, rays, 0, tested))) continue;
      Float distance = hit.distance;
      hit.distance = select(tested, distance, splat(-1.0f));
      intersect_geom(f, index, rays, passed, layered, hit);
      hit.distance = select(tested, hit.distance, distance);
    }
    return hit;
  });
}

// Return the transmittance of shadow rays up to `t_max`. `non_occluders`: as for `occluded`.
inline Float transmittance(const Frame& f, const PathFrame& p, Vec origin, Vec wi, Float t_max,
                           Int self, Mask active, unsigned non_occluders, Clearance* clearance) {
  // record the rays for the path cache
  if (clearance && p.transparent) note_ray(*clearance, origin, wi, t_max, active);
  if (clearance && !p.transparent) note_shadow_ray(*clearance, origin, wi, t_max, active);
  Float zero = splat(0.0f), one = splat(1.0f);
  // skip rays that can hit nothing
  if (!planes_may_occlude(f, non_occluders) &&
      !any_ray_near_sphere(f.finite_bounds, origin, wi, active)) {
    return select(active, one, zero);
  }
  RayCone cone = ray_cone(origin, wi, active, T_INFINITY);
  if (!p.transparent) {
    Mask blocked = occluded(f, origin, wi, t_max, self, cone, active, non_occluders);
    return select(blocked | ~active, zero, one);
  }
  Rays rays = {origin, wi, false};
  if (!p.transparent_geoms) {
    return through_layers(f, rays, t_max, active,
                          [&](Mask left, const Passed& passed, bool layered) {
                            return intersect(f, rays, cone, left, passed, layered);
                          });
  }
  Mask blocked = occluded<true>(f, origin, wi, t_max, self, cone, active, non_occluders);
  return through_geoms(f, p, rays, t_max, self, active & ~blocked);
}

// Next-event estimation of one of MuJoCo's lights: add the light that it reflects along -d, times
// `weight`.
inline void add_lamp(const Frame& f, const PathFrame& p, const Bsdf& s, Vec d,
                     const SurfaceInteraction<3>& interaction, Int self, Mask lit,
                     const Light& light, Point2 u_point, Float weight, Clearance* clearance,
                     Float* out) {
  Incidence in = incidence(light, interaction.point);
  if (!light.is_delta_direction() && light.ambient[0] + light.ambient[1] + light.ambient[2] > 0) {
    // ambient light fades with its light and has no shadow; that of directional lights belongs to
    // the environment
    Float share = select(lit, in.strength * weight, splat(0.0f));
    for (int c = 0; c < 3; c++) {
      out[c] = out[c] + (s.diffuse[c] + s.specular[c]) * share * light.ambient[c];
    }
  }
  if (light.is_bulb()) {
    // sample a direction to a bulb, which gives as much light as an emissive sphere
    Mask outside = in.distance > light.radius;
    BulbSample sample =
        sample_bulb(s, d, in.wi, in.distance, light.radius, u_point, p.world, lit & outside);
    in.wi = select(outside, sample.wi, in.wi);
    in.distance = select(outside, max(sample.distance, splat(0.0f)), in.distance);
    in.strength = select(outside, in.strength * sample.share, in.strength);
  }
  // trace shadow rays from the lanes that face the light
  Mask facing = lit & (dot(in.wi, s.normal) > 0.0f) &
                (dot(in.wi, interaction.geometric_normal) > 0.0f) & (in.strength > 0.0f) &
                (weight > 0.0f);
  if (!any(facing)) return;
  Float tr = select(facing, splat(1.0f), splat(0.0f));
  if (light.castshadow && f.shadows) {
    tr = transmittance(f, p, interaction.spawn_point, in.wi, in.distance, self, facing,
                       light.non_occluders, clearance);
    facing = facing & (tr > 0.0f);
    if (!any(facing)) return;
  }
  // add the light that the BSDF reflects
  BsdfValue v = evaluate_bsdf(s, d, in.wi);
  // a light of diffuse E gives a Lambertian surface the radiance albedo E: its irradiance is pi E
  Float scale = tr * weight * in.strength * PI;
  for (int c = 0; c < 3; c++) {
    Float reflected = s.specular[c] * v.specular * highlight(light, s.physical, c) +
                      s.diffuse[c] * v.lambert * light.diffuse[c];
    out[c] = out[c] + select(facing, reflected * scale, splat(0.0f));
  }
}

// Add radiance times throughput and `weight`, on `lanes`.
EVS_INLINE void add_radiance(const Float* throughput, const Float* light, Float weight, Mask lanes,
                             Float* out) {
  for (int c = 0; c < 3; c++) {
    out[c] = select(lanes, out[c] + throughput[c] * light[c] * weight, out[c]);
  }
}

// A packet of paths, all with the same number of bounces.
struct PathState {
  Rays rays;
  Hit hit;  // of the rays
  Float throughput[3];
  Float path_length;     // from the camera to the rays' origin
  Float pdf;             // of sampling the rays, per sr
  Mask specular_bounce;  // light sampling cannot find these: camera and mirror rays
  Float mirrored;        // width of the rays' pixel, in those of all samples: a mirror has fewer
  Sampler sampler;
};

// Add the environment's radiance along BSDF-sampled rays, weighted against light sampling. `tr`:
// the rays' transmittance.
inline void add_environment(const Frame& f, const PathFrame& p, const PathState& path, Float tr,
                            Mask lanes, Float* out) {
  Vec d = path.rays.direction;
  Float pdf = path.pdf;
  Mask specular_bounce = path.specular_bounce;
  EnvironmentPoint at = environment_point(f, d);
  Float light[3], light_pdf = environment_pdf(p, at);
  environment_radiance(f, p, at, select(specular_bounce, splat(T_INFINITY), pdf), specular_bounce,
                       path.mirrored, to_bits(lanes), light);
  Float weight = select(specular_bounce, splat(1.0f), pdf / max(pdf + light_pdf, splat(1e-30f)));
  add_radiance(path.throughput, light, weight * tr, lanes, out);
}

// Intersect the rays of `active`, and add the environment's radiance where they miss. `cone` bounds
// the rays; `from_geom`: where they start; `clearance` records every ray, or null. Out: the lanes
// to shade.
inline Mask intersect_paths(const Frame& f, const PathFrame& p, int bounce, PathState& path,
                            const RayCone& cone, Int from_geom, Mask active, Clearance* clearance,
                            Float* out) {
  const Rays& rays = path.rays;
  Float zero = splat(0.0f), one = splat(1.0f);
  // after the last bounce only the environment can add light, if no geom emits
  const bool environment_alone = bounce > p.bounces && (!p.emissive || !p.emits);
  if (environment_alone) {
    if (p.has_environment) {
      Float tr = transmittance(f, p, rays.origin, rays.direction, splat(T_INFINITY), from_geom,
                               active, 0, clearance);
      Mask clear = active & (tr > 0.0f);
      if (any(clear)) {
        add_environment(f, p, path, tr, clear, out);
      }
    }
    if (!p.emissive) return mask_from_bits(0);
  }
  Hit hit =
      intersect(f, rays, cone, active, from(bounce == 0 ? near_distance(f, rays.direction) : zero));
  Mask lit = active & ~(hit.geom < splat(0));
  if (p.transparent) {
    // pass through transparent surfaces at random
    Mask transmitted = on_transparent(f, hit, lit);
    for (int layer = 0; layer < MAX_LAYERS && any(transmitted); layer++) {
      SurfaceInteraction<3> interaction =
          surface_interaction<3>(f, rays, hit, to_bits(transmitted), path.path_length);
      Float u_alpha = sample_2d(path.sampler,
                                bounce * DIMENSIONS_PER_VERTEX + DIMENSIONS_PER_VERTEX - 1 - layer)
                          .x;
      transmitted = transmitted & lit & ~(u_alpha < interaction.alpha);
      if (!any(transmitted)) break;
      Hit next = intersect(f, rays, cone, transmitted, through(f, hit, transmitted), true);
      Mask found = transmitted & ~(next.geom < splat(0));
      lit = (lit & ~transmitted) | found;
      hit = {select(transmitted, next.distance, hit.distance),
             select(transmitted, next.geom, hit.geom),
             select(transmitted, next.triangle, hit.triangle), select(transmitted, next.u, hit.u),
             select(transmitted, next.v, hit.v)};
      transmitted = on_transparent(f, hit, found);
    }
  }
  // record the rays for the path cache
  path.hit = hit;
  if (clearance) {
    Float end = select(lit, hit.distance, splat(T_INFINITY));
    note_hit(*clearance, hit.geom, lit);
    note_ray(*clearance, rays.origin, rays.direction, end, active);
  }
  if (bounce == 0 && f.medium.haze) lit = lit & ~behind_haze(f, rays.direction, hit);
  // add the environment where they miss
  Mask missed = active & ~lit;
  if (any(missed) && bounce == 0 && f.skybox >= 0) {
    Float light[3];
    camera_environment<3>(f, rays, to_bits(missed), light);
    add_radiance(path.throughput, light, one, missed, out);
  } else if (any(missed) && bounce > 0 && p.has_environment && !environment_alone) {
    add_environment(f, p, path, one, missed, out);
  }
  return lit;
}

// A vertex of a packet of paths: interaction, BSDF, and the light reflected from MuJoCo's lights.
struct ShadingPoint {
  SurfaceInteraction<3> interaction;
  Bsdf bsdf;
  Float received[3];
};

// Shade the vertices of `lit`, whose interactions are given. Out: BSDF and received light in `at`;
// emitted light is added to `out`. False: the paths end. `lamp_clearance` records the shadow rays
// of the first vertex's lights.
inline bool direct_lighting(const Frame& f, const PathFrame& p, int bounce, const PathState& path,
                            Mask lit, Clearance* clearance, Clearance* lamp_clearance,
                            ShadingPoint& at, Float* out) {
  const Rays& rays = path.rays;
  const Hit& hit = path.hit;
  const Sampler& sampler = path.sampler;
  Float zero = splat(0.0f), one = splat(1.0f);
  int first_dimension = bounce * DIMENSIONS_PER_VERTEX;
  const SurfaceInteraction<3>& interaction = at.interaction;
  Mask emissive =
      lit & (interaction.emitted[0] + interaction.emitted[1] + interaction.emitted[2] > 0.0f);
  // add emitted radiance, weighted against light sampling
  if (any(emissive)) {
    Float weight = one;
    if (any(emissive & ~path.specular_bounce)) {
      Float light_pdf =
          emitter_pdf(f, p, rays, hit, interaction, to_bits(emissive & ~path.specular_bounce));
      weight =
          select(path.specular_bounce, one, path.pdf / max(path.pdf + light_pdf, splat(1e-30f)));
    }
    add_radiance(path.throughput, interaction.emitted, weight, emissive, out);
  }
  if (bounce > p.bounces) return false;

  const Bsdf& s = at.bsdf =
      make_bsdf(interaction, rays.direction, bounce == 0 ? p.lobe_samples : 1, p.world);
  Float* received = at.received;
  for (int c = 0; c < 3; c++) received[c] = zero;
  // sample MuJoCo's lights: all at the first vertex, one at random later
  int count = p.lamp_count;
  if (bounce == 0) {
    LazyBounds bounds;
    visit_lights(f, 0, f.light_count, interaction, bounds, lit, [&](int i) {
      if (f.lights[i].is_image()) return;
      Point2 u_point = {zero, zero};
      if (f.lights[i].is_bulb()) u_point = sample_2d(sampler, first_dimension + DIM_LAMP + 1 + i);
      add_lamp(f, p, s, rays.direction, interaction, hit.geom, lit, f.lights[i], u_point, one,
               lamp_clearance, received);
    });
  } else if (count > 0) {
    Float u_lamp = sample_2d(sampler, first_dimension + DIM_LAMP).x * static_cast<float>(count);
    Point2 u_point = sample_2d(sampler, first_dimension + DIM_LAMP + 1);
    Int chosen = truncate(u_lamp);
    Mask left = lit;
    for (int i = 0, lamp = 0; i < f.light_count && any(left); i++) {
      if (f.lights[i].is_image()) continue;
      Mask here = left & (chosen == splat(lamp++));
      if (!any(here)) continue;
      left = left & ~here;
      add_lamp(f, p, s, rays.direction, interaction, hit.geom, here, f.lights[i], u_point,
               splat(static_cast<float>(count)), clearance, received);
    }
  }
  return true;
}

// The same, evaluating the interactions first.
inline bool reach_surface(const Frame& f, const PathFrame& p, int bounce, const PathState& path,
                          Mask lit, Clearance* clearance, Clearance* lamp_clearance,
                          ShadingPoint& at, Float* out) {
  at.interaction = surface_interaction<3>(f, path.rays, path.hit, to_bits(lit), path.path_length);
  return direct_lighting(f, p, bounce, path, lit, clearance, lamp_clearance, at, out);
}

// Sample the light that the vertices of `lit` scatter, and the next rays. Out: the lanes that
// continue; from_geom: the vertices' geoms; sampled_light: the light found by light sampling.
inline Mask scatter_paths(const Frame& f, const PathFrame& p, int bounce, PathState& path, Mask lit,
                          Clearance* clearance, const ShadingPoint& at, Int& from_geom,
                          Float* sampled_light, Float* out) {
  const Rays& rays = path.rays;
  const Hit& hit = path.hit;
  const Sampler& sampler = path.sampler;
  Float zero = splat(0.0f);
  int first_dimension = bounce * DIMENSIONS_PER_VERTEX;
  for (int c = 0; c < 3; c++) sampled_light[c] = zero;
  const SurfaceInteraction<3>& interaction = at.interaction;
  const Bsdf& s = at.bsdf;
  // choose an emitter or the environment, and sample a direction to it
  if (p.emitter_count > 0 || p.environment_probability > 0) {
    Point2 u_choice = sample_2d(sampler, first_dimension + DIM_LIGHT_SELECTION),
           u_point = sample_2d(sampler, first_dimension + DIM_LIGHT_POINT);
    Mask to_environment = lit & (u_choice.x < p.environment_probability);
    Mask to_emitter = lit & ~to_environment;
    LightSample light_sample = {s.normal, zero, {zero, zero, zero}, zero};
    EnvironmentPoint environment_at;
    if (p.emitter_count > 0 && any(to_emitter)) {
      light_sample = sample_emitter(f, p, interaction.spawn_point, u_choice.y, u_point, to_emitter,
                                    path.path_length + hit.distance);
    }
    if (any(to_environment)) {
      LightSample environment_sample = sample_environment(f, p, u_point, environment_at);
      light_sample.wi = select(to_environment, environment_sample.wi, light_sample.wi);
      light_sample.distance =
          select(to_environment, environment_sample.distance, light_sample.distance);
      light_sample.pdf = select(to_environment, environment_sample.pdf, light_sample.pdf);
    }
    // evaluate the BSDF, and the radiance of the environment
    BsdfValue v = evaluate_bsdf(s, rays.direction, light_sample.wi);
    to_environment = to_environment & (v.pdf > 0.0f);
    if (any(to_environment)) {
      Float light[3];
      environment_radiance(f, p, environment_at, v.pdf, mask_from_bits(0), splat(1.0f),
                           to_bits(to_environment), light);
      for (int c = 0; c < 3; c++)
        light_sample.light[c] = select(to_environment, light[c], light_sample.light[c]);
    }
    // trace shadow rays and weigh the light against BSDF sampling
    Mask facing = lit & (light_sample.pdf > 0.0f) & (v.pdf > 0.0f) &
                  (dot(light_sample.wi, interaction.geometric_normal) > 0.0f);
    if (any(facing)) {
      // stop just before the emitter's surface
      Float t_max = light_sample.distance * 0.9999f;
      Float tr = transmittance(f, p, interaction.spawn_point, light_sample.wi, t_max, hit.geom,
                               facing, 0, clearance);
      Float weight = tr / (v.pdf + light_sample.pdf);
      for (int c = 0; c < 3; c++) {
        sampled_light[c] = select(facing, v.f_cos[c] * light_sample.light[c] * weight, zero);
      }
    }
  }
  for (int c = 0; c < 3; c++) {
    out[c] = select(lit, out[c] + path.throughput[c] * (at.received[c] + sampled_light[c]), out[c]);
  }

  // sample the BSDF for the next ray
  Point2 u_lobe = sample_2d(sampler, first_dimension + DIM_BSDF_LOBE),
         u_direction = sample_2d(sampler, first_dimension + DIM_BSDF_DIRECTION);
  if (bounce == 0 && any(lit & (s.mirror > 0.0f)))
    u_lobe.x = mirror_choice(sampler, DIM_PIXEL, u_lobe.x);
  BsdfSample next = sample_bsdf(s, rays.direction, u_lobe, u_direction);
  Mask active = lit & next.alive & (dot(next.direction, interaction.geometric_normal) > 0.0f);
  // update the throughput
  Float max_throughput = zero;
  for (int c = 0; c < 3; c++) {
    path.throughput[c] = path.throughput[c] * next.weight[c];
    max_throughput = max(max_throughput, path.throughput[c]);
  }
  active = active & (max_throughput > 0.0f);
  // Russian roulette
  if (bounce >= ROULETTE_START_DEPTH) {
    Float survival_probability = min(max_throughput * (1 / ROULETTE_THROUGHPUT), splat(1.0f));
    active = active & (sample_2d(sampler, first_dimension + DIM_ROULETTE).y < survival_probability);
    Float inverse = 1.0f / max(survival_probability, splat(1e-20f));
    for (int c = 0; c < 3; c++) path.throughput[c] = path.throughput[c] * inverse;
  }
  // spawn the next rays
  path.specular_bounce = next.specular;
  path.pdf = next.pdf;
  if (bounce == 0) {
    path.mirrored =
        select(next.specular, 1.0f / sqrt(max(s.mirror_probability, splat(1e-6f))), splat(1.0f));
  }
  path.path_length = path.path_length + hit.distance;
  from_geom = hit.geom;
  path.rays = {interaction.spawn_point, next.direction, false};
  return active;
}

// Shade the vertices of `lit` and sample the next rays, as of `scatter_paths`.
inline Mask shade_paths(const Frame& f, const PathFrame& p, int bounce, PathState& path, Mask lit,
                        Clearance* clearance, Clearance* lamp_clearance, Int& from_geom,
                        Float* sampled_light, Float* out) {
  ShadingPoint at;
  if (!reach_surface(f, p, bounce, path, lit, clearance, lamp_clearance, at, out)) {
    for (int c = 0; c < 3; c++) sampled_light[c] = splat(0.0f);
    return mask_from_bits(0);
  }
  return scatter_paths(f, p, bounce, path, lit, clearance, at, from_geom, sampled_light, out);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
