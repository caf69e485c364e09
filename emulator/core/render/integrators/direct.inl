// The `direct` integrator: every light once, shadow rays, one mirror bounce. It is deterministic:
// no random numbers.
#pragma once

#include "render/geometry/camera.inl"
#include "render/geometry/culling.inl"
#include "render/incremental/packet_record.inl"
#include "render/integrators/film.inl"
#include "render/shading/bsdf.inl"
#include "render/shading/environment.inl"
#include "render/shading/fog.inl"
#include "render/shading/lights.inl"
#include "render/shading/surface_interaction.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Diffuse reflectance of a surface: for direct light and for ambient light.
template <int CHANNELS>
struct DiffuseReflectance {
  Float direct[CHANNELS], ambient[CHANNELS];
};

template <int CHANNELS>
DiffuseReflectance<CHANNELS> diffuse_reflectance(const Frame& f,
                                                 const SurfaceInteraction<CHANNELS>& interaction) {
  DiffuseReflectance<CHANNELS> out;
  for (int c = 0; c < CHANNELS; c++) out.direct[c] = out.ambient[c] = interaction.albedo[c];
  if (!f.lobes) return out;
  for (int c = 0; c < CHANNELS; c++) {
    // the specular lobe of a physical surface reflects its share of the ambient light
    Float specular = select(interaction.physical, interaction.f0[c], splat(0.0f));
    out.direct[c] = interaction.albedo[c] * (1.0f - interaction.metallic);
    out.ambient[c] = (out.direct[c] + specular) * interaction.occlusion;
  }
  return out;
}

// Add an image light, without shadows. Specular lobes see it as blurred as a diffuse surface does,
// in the mirror direction.
template <int CHANNELS>
void add_image_light(const Frame& f, const Light& light, const Rays& rays,
                     const SurfaceInteraction<CHANNELS>& interaction,
                     const DiffuseReflectance<CHANNELS>& rho, Float* out) {
  Float received[CHANNELS];
  image_irradiance<CHANNELS>(f, light, interaction.normal, received);
  Float open = f.lobes ? interaction.occlusion : splat(1.0f);
  for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + rho.direct[c] * open * received[c];
  if (!f.lobes || !any(interaction.physical)) return;
  Vec d = rays.direction;
  image_irradiance<CHANNELS>(f, light, d - interaction.normal * (dot(d, interaction.normal) * 2.0f),
                             received);
  for (int c = 0; c < CHANNELS; c++) {
    Float specular = out[c] + interaction.f0[c] * open * received[c];
    out[c] = select(interaction.physical, specular, out[c]);
  }
}

// Add the light that lights `begin` ... `end` - 1 send along the rays towards their origin.
// `bounds`: of the interactions of `lit`.
template <int CHANNELS>
void add_lights(const Frame& f, const Rays& rays, const Hit& hit,
                const SurfaceInteraction<CHANNELS>& interaction, LazyBounds& bounds, Mask lit,
                int begin, int end, Float* out) {
  DiffuseReflectance<CHANNELS> rho = diffuse_reflectance(f, interaction);
  Mask physical = f.lobes ? interaction.physical & lit : mask_from_bits(0);
  auto add_light = [&](int i) {
    const Light& light = f.lights[i];
    if (light.is_image()) return add_image_light(f, light, rays, interaction, rho, out);
    // find the lanes that face the light
    Incidence in = incidence(light, interaction.point);
    Float cosine = dot(in.wi, interaction.normal);
    Mask facing = lit & (cosine > 0.0f) & (in.strength > 0.0f);
    // a normal map can turn the normal towards a light behind the surface
    if (f.normal_mapped) facing = facing & (dot(in.wi, interaction.unmapped_normal) > 0.0f);
    for (int c = 0; c < CHANNELS; c++) {
      out[c] = out[c] + rho.ambient[c] * in.strength * light.ambient[c];
    }
    if (!any(facing)) return;
    // trace shadow rays, unless they can hit nothing
    Mask blocked = mask_from_bits(0);
    if (light.castshadow && f.shadows &&
        (planes_may_occlude(f, light.non_occluders) ||
         any_ray_near_sphere(f.finite_bounds, interaction.spawn_point, in.wi, facing))) {
      blocked =
          occluded(f, interaction.spawn_point, in.wi, in.distance, hit.geom,
                   shadow_cone(light, bounds.of(interaction, lit)), facing, light.non_occluders);
    }
    Mask reached = facing & ~blocked;
    if (!any(reached)) return;
    // diffuse
    Float received = select(reached, cosine * in.strength, splat(0.0f));
    for (int c = 0; c < CHANNELS; c++)
      out[c] = out[c] + rho.direct[c] * received * light.diffuse[c];
    // GGX specular lobe
    if (any(reached & physical)) {
      Vec view = rays.direction * splat(-1.0f);
      Float lobe = ggx_lobe(interaction.normal, view, in.wi, interaction.alpha_ggx) * in.strength;
      lobe = select(reached & physical, lobe, splat(0.0f));
      for (int c = 0; c < CHANNELS; c++)
        out[c] = out[c] + lobe * interaction.f0[c] * light.diffuse[c];
    }
    // Blinn-Phong highlight
    Mask glossy = reached & ~physical & (interaction.specular > 0.0f);
    if (!any(glossy) ||
        light.specular[0] + light.specular[CHANNELS / 2] + light.specular[CHANNELS - 1] <= 0)
      return;
    Vec half = normalize(in.wi - rays.direction);
    Float lobe = min(max(dot(half, interaction.normal), splat(0.0f)), splat(1.0f));
    // skip lanes far from the highlight, where lobe^exponent < exp(-16.7) = 2^-24
    glossy = glossy & ((1.0f - lobe) * interaction.exponent < 16.7f);
    if (!any(glossy)) return;
    Float specular = pow(lobe, interaction.exponent, glossy) * interaction.specular * in.strength;
    specular = select(glossy, specular, splat(0.0f));
    for (int c = 0; c < CHANNELS; c++) {
      out[c] = out[c] + specular * interaction.specular_tint[c] * light.specular[c];
    }
  };
  visit_lights(f, begin, end, interaction, bounds, lit, add_light);
}

// Compute the radiance that leaves the surface. In: where to cache the shading, or null.
template <int CHANNELS>
void shade_direct(const Frame& f, const Rays& rays, const Hit& hit,
                  const SurfaceInteraction<CHANNELS>& interaction, LazyBounds& bounds, Mask lit,
                  const CachedShading* shading, Float* out) {
  for (int c = 0; c < CHANNELS; c++) out[c] = interaction.emitted[c];
  // cache the light of the first lights, then add the others
  int first = 0;
  if (shading) {
    first = shading->lights;
    add_lights<CHANNELS>(f, rays, hit, interaction, bounds, lit, 0, first, out);
    cache_shading<CHANNELS>(hit, interaction, out, *shading);
  }
  add_lights<CHANNELS>(f, rays, hit, interaction, bounds, lit, first, f.light_count, out);
}

// How `direct` shades a surface.
struct DirectShading {
  static constexpr int MIRRORS = 1;  // off which a ray is followed, as in MuJoCo's viewer

  template <int CHANNELS>
  void shade(const Frame& f, const Rays& rays, const Hit& hit,
             const SurfaceInteraction<CHANNELS>& interaction, LazyBounds& bounds, Mask lit, Float,
             const CachedShading* shading, Float* out) const {
    shade_direct<CHANNELS>(f, rays, hit, interaction, bounds, lit, shading, out);
  }
  // for those that keep what they shade: an image in a mirror, the weight of a surface and the
  // light before it, the light of a whole sample
  template <int CHANNELS>
  void mirrored(const Float*, Mask) const {}
  template <int CHANNELS>
  void composited(const Float*, Float, Mask) const {}
  template <int CHANNELS>
  void sampled(const Float*) const {}
};

template <bool CAMERA>
struct HitOfRays {
  using Type = Hit;
};
template <>
struct HitOfRays<true> {
  using Type = CoveredHit;
};

template <int CHANNELS, int MIRRORS, class Shading>
void radiance(const Shading& shading, const Frame& f, const Rays& rays, const RayCone& cone,
              Mask active, Float path_length, RayRecorder* recorder, Float* out,
              const Hit* first = nullptr);

// Add the mirror image seen in the lanes `mirror`, times the reflectance. `box`: bounds of the
// mirrors' points. `empty`: the image is known to be empty. MIRRORS: as of `radiance`, of the
// image.
template <int CHANNELS, int MIRRORS, class Shading>
void reflect(const Shading& shading, const Frame& f, const Rays& rays,
             const SurfaceInteraction<CHANNELS>& interaction, const BoundingBox& box, Mask mirror,
             bool empty, Float path_length, RayRecorder* recorder, Float* surface) {
  // reflect the rays and bound them by a cone
  Vec d = rays.direction;
  Vec bounced = d - interaction.normal * (dot(d, interaction.normal) * 2.0f);
  Rays mirrored = {interaction.spawn_point, normalize(bounced), false};
  if (MIRRORS == 1) mirrored.mirror = &interaction.normal;
  float square;
  RayCone cone = ray_cone(box, mirrored.direction, mirror, T_INFINITY, square);
  // record the cone
  if (recorder) {
    if (recorder->mirror_spread < 0) {
      recorder->mirror_axis = cone.axis;
    } else {
      square = max_squared_chord(mirrored.direction, recorder->mirror_axis, mirror);
    }
    recorder->mirror_spread = square > recorder->mirror_spread ? square : recorder->mirror_spread;
  }
  // add the mirror image
  if (empty) return;
  Float image[CHANNELS];
  radiance<CHANNELS, MIRRORS>(shading, f, mirrored, cone, mirror, path_length, recorder, image);
  for (int c = 0; c < CHANNELS; c++) {
    image[c] = image[c] * interaction.reflectance;
    surface[c] = select(mirror, surface[c] + image[c], surface[c]);
  }
  if (MIRRORS == 1) shading.template mirrored<CHANNELS>(image, mirror);
}

// Compute the radiance along the rays of `active`: through transparent surfaces from front to back,
// and off mirrors. MIRRORS: how many the rays have been reflected by, 0: camera rays. Out: radiance
// by channel; the recorder is extended unless it is null. first: the first hits, or null.
template <int CHANNELS, int MIRRORS, class Shading>
void radiance(const Shading& shading, const Frame& f, const Rays& rays, const RayCone& cone,
              Mask active, Float path_length, RayRecorder* recorder, Float* out, const Hit* first) {
  constexpr bool CAMERA = MIRRORS == 0;
  for (int c = 0; c < CHANNELS; c++) out[c] = splat(0.0f);
  Float transmittance = splat(1.0f), haze_alpha = splat(0.0f), haze_distance = haze_alpha;
  // only rays of the camera begin at its near plane
  Passed passed = from(CAMERA ? near_distance(f, rays.direction) : splat(0.0f));
  const bool blends = CAMERA && f.outline_reach > 0;
  typename HitOfRays<CAMERA>::Type hit;
  if constexpr (CAMERA) {
    if (blends) hit.cells = cell_rays(f, rays);
  }
  Coverage before;  // by the last surface
  before.share = splat(0.0f);
  Mask blended = mask_from_bits(0);
  for (int layer = 0; layer < MAX_LAYERS; layer++) {
    // intersect the next layer
    static_cast<Hit&>(hit) = no_hit(active);
    if constexpr (CAMERA) hit.coverage = {};
    if (first && layer == 0) {
      static_cast<Hit&>(hit) = *first;
    } else {
      find_hits(f, rays, cone, active, passed, layer > 0, hit);
    }
    Mask lit = active & ~(hit.geom < splat(0));
    if (CAMERA && f.medium.haze) lit = lit & ~behind_haze(f, rays.direction, hit);
    Mask missed = active & ~lit;
    if (CAMERA && f.medium.haze && layer == 0) haze_alpha = haze(f, rays.direction, haze_distance);
    if (CAMERA && f.medium.haze) {
      // composite the haze over what is behind it
      Mask behind = active & (hit.distance > haze_distance);
      Float share = select(behind, transmittance * haze_alpha, splat(0.0f));
      Float haze_radiance[CHANNELS];
      for (int c = 0; c < CHANNELS; c++) haze_radiance[c] = splat(f.medium.haze_color[c]);
      if (f.medium.fog) apply_fog<CHANNELS>(f, haze_distance, haze_radiance);
      for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + haze_radiance[c] * share;
      transmittance = transmittance - share;
      haze_alpha = select(behind, splat(0.0f), haze_alpha);
    }
    bool fog = CAMERA && f.medium.fog;
    if (((CAMERA && f.skybox >= 0) || f.sky_shines || fog) && any(missed)) {
      Float light[CHANNELS];
      for (int c = 0; c < CHANNELS; c++) light[c] = splat(f.medium.fog_color[c]);
      if (!fog) camera_environment<CHANNELS>(f, rays, to_bits(missed), light);
      for (int c = 0; c < CHANNELS; c++) {
        out[c] = select(missed, out[c] + light[c] * transmittance, out[c]);
      }
    }
    if (!any(lit)) break;
    // shade the layer: what covers a part of a cell is seen in the middle of that part
    Rays seen = rays;
    const Float distance = hit.distance;
    Mask partly = mask_from_bits(0), lost = partly;
    if constexpr (CAMERA) {
      if (blends) partly = lit & (hit.coverage.share < 1.0f);
      if (any(partly)) lost = turn_to_covered(f, seen, hit, partly);
      lit = lit & ~lost;
      if (!any(lit)) {
        passed = through(f, hit, lost);
        active = lost;
        continue;
      }
    }
    SurfaceInteraction<CHANNELS> interaction =
        surface_interaction<CHANNELS>(f, seen, hit, to_bits(lit), path_length);
    if constexpr (CAMERA) {
      if (any(partly)) {
        Float share = uncovered_share(before, hit.coverage);
        interaction.alpha = select(partly, interaction.alpha * share, interaction.alpha);
        interaction.alpha = select(lost, splat(0.0f), interaction.alpha);
        partly = partly & ~lost;
        // nothing is known of how a third outline lies to the first two
        Mask second = partly & (before.share > 0.0f);
        before = choose(partly, hit.coverage, before);
        before.share = select(second, splat(0.0f), before.share);
        blended = blended | partly;
      }
    }
    LazyBounds bounds;
    if (recorder)
      extend(CAMERA ? recorder->primary_hits : recorder->mirror_hits, bounds.of(interaction, lit));
    Float surface[CHANNELS];
    bool caches = CAMERA && layer == 0 && recorder && recorder->shading.numbers && !any(partly) &&
                  can_cache_shading(f, hit, lit);
    shading.template shade<CHANNELS>(f, seen, hit, interaction, bounds, lit, path_length,
                                     caches ? &recorder->shading : nullptr, surface);
    // follow mirrors
    if constexpr (MIRRORS < Shading::MIRRORS) {
      Mask mirror = lit & (interaction.reflectance > 0.0f);
      // as in MuJoCo's viewer, a sky that is only a backdrop is in no mirror
      bool empty =
          !any(mirror) || (CAMERA && !f.sky_shines && mirror_is_empty(f, seen, hit, mirror));
      // the rays of a mirror in a mirror are not recorded
      RayRecorder* records = CAMERA ? recorder : nullptr;
      if (!empty || (records && any(mirror))) {
        reflect<CHANNELS, MIRRORS + 1>(shading, f, seen, interaction, bounds.of(interaction, lit),
                                       mirror, empty, path_length + hit.distance, records, surface);
      }
    }
    if (f.medium.fog) apply_fog<CHANNELS>(f, path_length + hit.distance, surface);
    // composite it, and continue behind it where it is transparent
    Float share = transmittance * interaction.alpha;
    if (CAMERA) shading.template composited<CHANNELS>(out, share, lit);
    for (int c = 0; c < CHANNELS; c++) out[c] = select(lit, out[c] + surface[c] * share, out[c]);
    active = (lit & (interaction.alpha < 1.0f)) | lost;
    if (!any(active)) break;
    transmittance = transmittance * (1.0f - interaction.alpha);
    hit.distance = distance;
    passed = through(f, hit, active);
  }
  if (CAMERA && f.marks_blended && any(blended)) {
    Float& untextured = out[CHANNELS - 1];
    untextured = select(blended, -untextured - 1e-30f, untextured);
  }
}

// Entry points: packets of pixels, with or without a record of their rays, and scattered pixels.

template <int CHANNELS, class Shading>
void trace_packet(const Shading& shading, const Frame& f, int column, int row, const Outputs& out,
                  const PacketRecord* record) {
  const RayCone& cone = PACKETS == 1 ? f.primary[row * f.packet_columns + column]
                                     : f.pairs[row * (f.packet_columns / 2) + column / 2];
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  // start without cached shading
  RayRecorder recorder;
  if (record && record->shading.numbers) {
    recorder.shading = record->shading;
    *record->shading.geom = -1;
  }
  // sum the samples
  for (int s = 0; s < f.samples; s++) {
    Rays rays = primary_rays(f, column, row, f.sample_x[s], f.sample_y[s]);
    Float light[CHANNELS];
    radiance<CHANNELS, 0>(shading, f, rays, cone, mask_from_bits(ALL_LANES), splat(0.0f),
                          record ? &recorder : nullptr, light);
    shading.template sampled<CHANNELS>(light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    if (out.rgb || out.untextured) {
      for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
    }
  }
  // record the rays, write the mean
  if (record) write_record(recorder, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

inline void trace(const Frame& f, int column, int row, const Outputs& out,
                  const PacketRecord* record) {
  for_channels(f, [&]<int CHANNELS>() {
    trace_packet<CHANNELS>(DirectShading{}, f, column, row, out, record);
  });
}

// Trace scattered pixels. Their rays share the camera only, so their cone is wide.
template <int CHANNELS>
void trace_scattered(const Frame& f, const int32_t* x, const int32_t* y, int count,
                     float* luminance, float* untextured) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  // sum the samples
  Float sum = splat(0.0f), sum_untextured = sum;
  Mask all = mask_from_bits(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = rays_through(f, pixel_point(column, f.sample_x[s], PACKET_WIDTH),
                             pixel_point(row, f.sample_y[s], PACKET_HEIGHT));
    Float light[CHANNELS];
    RayCone cone = camera_cone(f, rays);
    radiance<CHANNELS, 0>(DirectShading{}, f, rays, cone, all, splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    sum_untextured = sum_untextured + light[CHANNELS - 1];
  }
  // write the mean of each pixel
  alignas(64) float out[LANES];
  store(out, sum * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) {
    luminance[i] = vignetted(f, static_cast<long>(y[i]) * f.width + x[i], out[i]);
  }
  if (!untextured) return;
  store(out, sum_untextured * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) untextured[i] = out[i];
}

inline void trace_pixels(const Frame& f, const int32_t* x, const int32_t* y, int count,
                         float* luminance, float* untextured) {
  for_channels(
      f, [&]<int CHANNELS>() { trace_scattered<CHANNELS>(f, x, y, count, luminance, untextured); });
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
