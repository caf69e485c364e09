// The `direct` integrator: each light once, shadows, one mirror bounce. No random number at all.
#pragma once

#include "geometry/culling.inl"
#include "incremental/packet_record.inl"
#include "shading/environment.inl"
#include "shading/fog.inl"
#include "shading/lights.inl"
#include "shading/microfacet.inl"
#include "shading/surface_interaction.inl"

namespace evs::EVS_SPACE {
namespace {

// How much of the light a surface gives back evenly: of a lamp's, and of light from everywhere.
template <int CHANNELS>
struct Matt {
  Float lamp[CHANNELS], ambient[CHANNELS];
};

template <int CHANNELS>
Matt<CHANNELS> matt_of(const Frame& f, const Patch<CHANNELS>& patch) {
  Matt<CHANNELS> out;
  for (int c = 0; c < CHANNELS; c++) out.lamp[c] = out.ambient[c] = patch.albedo[c];
  if (!f.lobes) return out;
  for (int c = 0; c < CHANNELS; c++) {
    // the gloss of a physical surface takes its share of light from everywhere
    Float gloss = select(patch.physical, patch.f0[c], splat(0.0f));
    out.lamp[c] = patch.albedo[c] * (1.0f - patch.metallic);
    out.ambient[c] = (out.lamp[c] + gloss) * patch.occlusion;
  }
  return out;
}

// An image light: no shadow, and the gloss sees it as blurred as paper does, but where it mirrors.
template <int CHANNELS>
void shade_image(const Frame& f, const Light& light, const Rays& rays, const Patch<CHANNELS>& patch,
                 const Matt<CHANNELS>& matt, Float* out) {
  Float received[CHANNELS];
  received_from_image<CHANNELS>(f, light, patch.normal, received);
  Float open = f.lobes ? patch.occlusion : splat(1.0f);
  for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + matt.lamp[c] * open * received[c];
  if (!f.lobes || !any(patch.physical)) return;
  Vec d = rays.direction;
  received_from_image<CHANNELS>(f, light, d - patch.normal * (dot(d, patch.normal) * 2.0f),
                                received);
  for (int c = 0; c < CHANNELS; c++) {
    Float gloss = out[c] + patch.f0[c] * open * received[c];
    out[c] = select(patch.physical, gloss, out[c]);
  }
}

// What lights `begin` ... `end` - 1 send from the surface towards the ray's origin. `points`: those
// of `lit`.
template <int CHANNELS>
void add_lights(const Frame& f, const Rays& rays, const Hit& hit, const Patch<CHANNELS>& patch,
                Points& points, Mask lit, int begin, int end, Float* out) {
  Matt<CHANNELS> matt = matt_of(f, patch);
  Mask physical = f.lobes ? patch.physical & lit : mask_of(0);
  for (int i = begin; i < end; i++) {
    const Light& light = f.lights[i];
    if (light.kind == IMAGE) {
      shade_image(f, light, rays, patch, matt, out);
      continue;
    }
    Incidence in = incidence(light, patch.point);
    Float cosine = dot(in.towards, patch.normal);
    Mask facing = lit & (cosine > 0.0f) & (in.strength > 0.0f);
    // a bent normal may see a lamp that is behind the surface
    if (f.bumpy) facing = facing & (dot(in.towards, patch.plain) > 0.0f);
    for (int c = 0; c < CHANNELS; c++) {
      out[c] = out[c] + matt.ambient[c] * in.strength * light.ambient[c];
    }
    if (!any(facing)) continue;
    Mask dark = mask_of(0);
    if (light.castshadow && f.shadows &&
        (barred_by_planes(f, light.idle) ||
         any_towards(f.around, patch.origin, in.towards, facing))) {
      dark = occluded(f, patch.origin, in.towards, in.distance, hit.geom,
                      shadow_hull(light, points.of(patch, lit)), facing, light.idle);
    }
    Mask reached = facing & ~dark;
    if (!any(reached)) continue;
    Float received = select(reached, cosine * in.strength, splat(0.0f));
    for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + matt.lamp[c] * received * light.diffuse[c];
    if (any(reached & physical)) {
      Vec view = rays.direction * splat(-1.0f);
      Float lobe = ggx(patch.normal, view, in.towards, patch.alpha_ggx) * in.strength;
      lobe = select(reached & physical, lobe, splat(0.0f));
      for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + lobe * patch.f0[c] * light.diffuse[c];
    }
    // Blinn-Phong
    Mask glossy = reached & ~physical & (patch.specular > 0.0f);
    if (!any(glossy) ||
        light.specular[0] + light.specular[CHANNELS / 2] + light.specular[CHANNELS - 1] <= 0)
      continue;
    Vec half = normalize(in.towards - rays.direction);
    Float lobe = min(max(dot(half, patch.normal), splat(0.0f)), splat(1.0f));
    // far from the highlight, where lobe^exponent < exp(-16.7) = 2^-24, there is none
    glossy = glossy & ((1.0f - lobe) * patch.exponent < 16.7f);
    if (!any(glossy)) continue;
    Float gloss = power(lobe, patch.exponent, glossy) * patch.specular * in.strength;
    gloss = select(glossy, gloss, splat(0.0f));
    for (int c = 0; c < CHANNELS; c++) {
      out[c] = out[c] + gloss * patch.gloss_tint[c] * light.specular[c];
    }
  }
}

// Light that leaves the surface. In: keep, where to, or null.
template <int CHANNELS>
void shade(const Frame& f, const Rays& rays, const Hit& hit, const Patch<CHANNELS>& patch,
           Points& points, Mask lit, const KeptPatch* keep, Float* out) {
  for (int c = 0; c < CHANNELS; c++) out[c] = patch.emitted[c];
  int first = 0;
  if (keep) {
    first = keep->lights;
    add_lights<CHANNELS>(f, rays, hit, patch, points, lit, 0, first, out);
    store_patch<CHANNELS>(hit, patch, out, *keep);
  }
  add_lights<CHANNELS>(f, rays, hit, patch, points, lit, first, f.light_count, out);
}

template <int CHANNELS, bool FOLLOW>
void radiance(const Frame& f, const Rays& rays, const Hull& hull, Mask active, Float travelled,
              Notes* notes, Float* out);

// What the mirrors of `mirror` show, times their reflectance, is added to `surface`. `region`:
// where their points are. `empty`: they are known to show nothing.
template <int CHANNELS>
void reflect(const Frame& f, const Rays& rays, const Patch<CHANNELS>& patch, const Region& region,
             Mask mirror, bool empty, Float travelled, Notes* notes, Float* surface) {
  Vec d = rays.direction;
  Vec bounced = d - patch.normal * (dot(d, patch.normal) * 2.0f);
  Rays mirrored = {patch.origin, normalize(bounced), false};
  float square;
  Hull cone = hull_of(region, mirrored.direction, mirror, FAR, square);
  if (notes) {
    if (notes->mirror_spread < 0) {
      notes->mirror_axis = cone.axis;
    } else {
      square = spread(mirrored.direction, notes->mirror_axis, mirror);
    }
    notes->mirror_spread = square > notes->mirror_spread ? square : notes->mirror_spread;
  }
  if (empty) return;
  Float image[CHANNELS];
  radiance<CHANNELS, false>(f, mirrored, cone, mirror, travelled, notes, image);
  for (int c = 0; c < CHANNELS; c++) {
    surface[c] = select(mirror, surface[c] + image[c] * patch.reflectance, surface[c]);
  }
}

// Radiance along the rays of `active`: through transparent surfaces, front to back, and with FOLLOW
// once off a mirror. Out: the light of each channel; notes, which grows, unless it is null.
template <int CHANNELS, bool FOLLOW>
void radiance(const Frame& f, const Rays& rays, const Hull& hull, Mask active, Float travelled,
              Notes* notes, Float* out) {
  for (int c = 0; c < CHANNELS; c++) out[c] = splat(0.0f);
  Float passing = splat(1.0f), beyond = splat(0.0f), cover = beyond, curtain = beyond;
  for (int layer = 0; layer < MAX_LAYERS; layer++) {
    Hit hit = closest(f, rays, hull, active, beyond);
    Mask lit = active & ~(hit.geom < splat(0));
    if (FOLLOW && f.air.haze) lit = lit & ~beyond_haze(f, rays.direction, hit);
    Mask missed = active & ~lit;
    if (FOLLOW && f.air.haze && layer == 0) cover = haze(f, rays.direction, curtain);
    if (FOLLOW && f.air.haze) {
      // what is hit behind the haze, or nothing
      Mask behind = active & (hit.distance > curtain);
      Float share = select(behind, passing * cover, splat(0.0f));
      Float veil[CHANNELS];
      for (int c = 0; c < CHANNELS; c++) veil[c] = splat(f.air.haze_color[c]);
      if (f.air.fog) fog<CHANNELS>(f, curtain, veil);
      for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + veil[c] * share;
      passing = passing - share;
      cover = select(behind, splat(0.0f), cover);
    }
    // mirrors do not show the sky, as in MuJoCo's viewer
    if (FOLLOW && (f.skybox >= 0 || f.air.fog) && any(missed)) {
      Float light[CHANNELS];
      for (int c = 0; c < CHANNELS; c++) light[c] = splat(f.air.fog_color[c]);
      if (!f.air.fog) sky<CHANNELS>(f, rays.direction, bits(missed), light);
      for (int c = 0; c < CHANNELS; c++) {
        out[c] = select(missed, out[c] + light[c] * passing, out[c]);
      }
    }
    if (!any(lit)) break;
    Patch<CHANNELS> patch = patch_of<CHANNELS>(f, rays, hit, bits(lit), travelled);
    Points points;
    if (notes) grow(FOLLOW ? notes->seen : notes->mirrored, points.of(patch, lit));
    Float surface[CHANNELS];
    bool keeps = FOLLOW && layer == 0 && notes && notes->keep.numbers && can_keep(f, hit, lit);
    shade<CHANNELS>(f, rays, hit, patch, points, lit, keeps ? &notes->keep : nullptr, surface);
    if constexpr (FOLLOW) {
      Mask mirror = lit & (patch.reflectance > 0.0f);
      bool empty = !any(mirror) || mirrors_nothing(f, rays, hit, mirror);
      if (!empty || (notes && any(mirror))) {
        reflect<CHANNELS>(f, rays, patch, points.of(patch, lit), mirror, empty,
                          travelled + hit.distance, notes, surface);
      }
    }
    if (f.air.fog) fog<CHANNELS>(f, travelled + hit.distance, surface);
    Float share = passing * patch.alpha;
    for (int c = 0; c < CHANNELS; c++) out[c] = select(lit, out[c] + surface[c] * share, out[c]);
    active = lit & (patch.alpha < 1.0f);
    if (!any(active)) break;
    passing = passing * (1.0f - patch.alpha);
    beyond = hit.distance;
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
