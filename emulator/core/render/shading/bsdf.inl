// The BSDF of the `path` integrator: a perfect mirror of `reflectance`, a GGX specular lobe of
// width alpha with the angle-independent reflectance f0, and a Lambertian lobe with the rest of the
// albedo. The mirror takes its share from the lobes of physical surfaces. Classic ones reflect it
// in addition, as in MuJoCo, and so may reflect more than they receive.
//
// GGX has the Smith masking-shadowing of Walter et al. 2007. Directions are sampled from the
// distribution of visible normals (Heitz 2018; Dupuy & Benyoub 2023). The BSDF is reciprocal.
#pragma once

#include "render/shading/surface_interaction.inl"
#include "scene/light.h"

namespace evs::EVS_NAMESPACE {
namespace {

// pi times the GGX distribution of microfacet normals (Trowbridge & Reitz), for a unit half vector.
EVS_INLINE Float microfacet_distribution(Vec normal, Vec half_vector, Float alpha) {
  // use the sine itself: 1 - cosine^2 would cancel in a narrow lobe
  Vec sine = cross(normal, half_vector);
  Float cosine = dot(normal, half_vector), alpha2 = alpha * alpha;
  Float denominator = dot(sine, sine) + alpha2 * cosine * cosine;
  return alpha2 / (denominator * denominator);
}

// pi times the GGX BRDF for a reflectance of 1, times cos_in (Walter et al. 2007, with their
// separable Smith shadowing). In: unit vectors away from the surface, both on the normal's side. No
// divisor is less than alpha^2 times 1e-4.
EVS_INLINE Float ggx_lobe(Vec normal, Vec wo, Vec wi, Float alpha) {
  Float alpha2 = alpha * alpha, one_minus_alpha2 = 1.0f - alpha2;
  Float cos_in = max(dot(normal, wi), splat(0.0f)), cos_out = max(dot(normal, wo), splat(1e-4f));
  Float masking = (cos_in + sqrt(cos_in * cos_in * one_minus_alpha2 + alpha2)) *
                  (cos_out + sqrt(cos_out * cos_out * one_minus_alpha2 + alpha2));
  return microfacet_distribution(normal, normalize(wo + wi), alpha) / masking * cos_in;
}

constexpr float PI = 3.14159265f;

// Build an orthonormal basis around the unit normal n (Duff et al. 2017).
EVS_INLINE void axes_of(Vec n, Vec& x, Vec& y) {
  Float sign = select(n.z < 0.0f, splat(-1.0f), splat(1.0f));
  Float a = -1.0f / (sign + n.z), b = n.x * n.y * a;
  x = {sign * n.x * n.x * a + 1.0f, sign * b, -(sign * n.x)};
  y = {b, sign + n.y * n.y * a, -n.y};
}

// The same in the camera frame; with `world`, camera to world or null, they stay where they are as
// the camera turns.
EVS_INLINE void axes_of(Vec n, const float* world, Vec& x, Vec& y) {
  axes_of(world ? to_camera(world, n) : n, x, y);
  if (!world) return;
  x = to_local(world, x);
  y = to_local(world, y);
}

struct Bsdf {
  Vec normal, x, y;
  Float cos_outgoing;  // towards the eye, above 0
  Float alpha;         // width of the specular lobe
  Mask physical;       // others are classic: lamps have a colour of their own for their highlights
  Float specular[3], diffuse[3];
  Float mirror;                // reflectance of the perfect mirror
  Float mirror_probability;    // with which it is chosen
  Float specular_probability;  // of the specular lobe, where the mirror is not chosen
};

// The probability of the mirror where a pixel has several samples: the multiple of 1 / samples
// nearest to its share, neither 0 nor 1. Of stratified samples as many are then mirrored in every
// pixel, instead of one more in some.
EVS_INLINE Float even_probability(Float mirror, int samples) {
  if (samples < 2) return mirror;
  const float count = static_cast<float>(samples);
  Float whole = to_float(truncate(mirror * count + 0.5f));
  whole = min(max(whole, splat(1.0f)), splat(count - 1.0f));
  return select((mirror > 0.0f) & (mirror < 1.0f), whole * (1.0f / count), mirror);
}

// The share of the light that a mirror leaves to the lobes of its surface.
EVS_INLINE Float beside_mirror(Float mirror, Mask physical) {
  return select(physical, 1.0f - mirror, splat(1.0f));
}

// Build the BSDF of an interaction. wo is -d; `samples` are those of a pixel that meet here;
// `world`: of axes_of.
EVS_INLINE Bsdf make_bsdf(const SurfaceInteraction<3>& interaction, Vec d, int samples,
                          const float* world) {
  Bsdf s;
  s.normal = interaction.normal;
  axes_of(s.normal, world, s.x, s.y);
  s.cos_outgoing = max(-dot(d, s.normal), splat(1e-4f));
  // a narrower lobe is a mirror in single precision
  s.alpha = min(max(interaction.alpha_ggx, splat(0.002f)), splat(1.0f));
  s.physical = interaction.physical;
  s.mirror = min(max(interaction.reflectance, splat(0.0f)), splat(1.0f));
  // a classic surface shows in full beneath its mirror, so at least half of the samples see it
  Float most = select(interaction.physical, splat(1.0f), splat(0.5f));
  s.mirror_probability = even_probability(min(s.mirror, most), samples);
  // divide what the mirror leaves between the lobes
  Float specular = splat(0.0f), diffuse = splat(0.0f);
  Float rest = beside_mirror(s.mirror, interaction.physical);
  for (int c = 0; c < 3; c++) {
    Float f0 = min(max(interaction.f0[c], splat(0.0f)), splat(1.0f));
    s.specular[c] = rest * f0;
    s.diffuse[c] = rest * max(interaction.albedo[c], splat(0.0f)) * (1.0f - interaction.metallic) *
                   (1.0f - f0);
    specular = specular + s.specular[c];
    diffuse = diffuse + s.diffuse[c];
  }
  // sample the lobes in proportion to their albedo, each at least at one in ten
  Float share = specular / max(specular + diffuse, splat(1e-20f));
  share = max(min(share, splat(0.9f)), splat(0.1f));
  s.specular_probability =
      select(specular > 0.0f, select(diffuse > 0.0f, share, splat(1.0f)), splat(0.0f));
  return s;
}

// Smith masking of one direction, for a cosine above 0.
EVS_INLINE Float smith_g1(Float cosine, Float alpha) {
  Float alpha2 = alpha * alpha;
  return 2.0f * cosine / (cosine + sqrt(alpha2 + (1.0f - alpha2) * cosine * cosine));
}

// pdf (per sr) of `sample_visible_normal` for w.
EVS_INLINE Float visible_normal_pdf(const Bsdf& s, Vec d, Vec w) {
  Float distribution = microfacet_distribution(s.normal, normalize(w - d), s.alpha) * (1.0f / PI);
  return distribution * smith_g1(s.cos_outgoing, s.alpha) / (s.cos_outgoing * 4.0f);
}

// Sample a visible microfacet: uniform on the spherical cap that the stretched wo sees. In: a
// number in [0, 1), and cosine and sine of a uniform angle. Out: wo mirrored in it, in the axes of
// `s`.
EVS_INLINE Vec sample_visible_normal(const Bsdf& s, Vec d, Float u, Float cosine, Float sine) {
  Vec wo = {-dot(d, s.x), -dot(d, s.y), s.cos_outgoing};
  Vec stretched = normalize({wo.x * s.alpha, wo.y * s.alpha, wo.z});
  Float z = (1.0f - u) * (1.0f + stretched.z) - stretched.z;
  Float ring = sqrt(min(max(1.0f - z * z, splat(0.0f)), splat(1.0f)));
  Vec cap = {ring * cosine + stretched.x, ring * sine + stretched.y, z + stretched.z};
  Vec microfacet = normalize({cap.x * s.alpha, cap.y * s.alpha, max(cap.z, splat(1e-7f))});
  return microfacet * (2.0f * dot(microfacet, wo)) - wo;
}

struct BsdfValue {
  Float f_cos[3];           // f times the cosine of w, without the mirror
  Float specular, lambert;  // its lobes, for a reflectance of 1
  Float pdf;                // of `sample_bsdf` for w, without the mirror, per sr
};

EVS_INLINE BsdfValue evaluate_bsdf(const Bsdf& s, Vec d, Vec w) {
  BsdfValue v;
  Float cos_incoming = dot(w, s.normal);
  Mask above = cos_incoming > 0.0f;
  Float cosine = max(cos_incoming, splat(0.0f));
  // the VNDF pdf of w is D G1(wo) / (4 cos(wo)); times G1(w) and F it is f cos
  Float vndf_pdf = visible_normal_pdf(s, d, w);
  v.specular = vndf_pdf * smith_g1(max(cosine, splat(1e-6f)), s.alpha);
  v.lambert = cosine * (1.0f / PI);
  for (int c = 0; c < 3; c++) {
    v.f_cos[c] = select(above, s.specular[c] * v.specular + s.diffuse[c] * v.lambert, splat(0.0f));
  }
  Float mixture_pdf =
      s.specular_probability * vndf_pdf + (1.0f - s.specular_probability) * v.lambert;
  v.pdf = select(above, (1.0f - s.mirror_probability) * mixture_pdf, splat(0.0f));
  return v;
}

// What a lamp's light makes in the specular lobe, of channel c: a classic surface shows the
// lamp's own `specular`, as in MuJoCo, a physical one what it shines.
EVS_INLINE Float highlight(const Light& light, Mask physical, int c) {
  return select(physical, splat(light.diffuse[c]), splat(light.specular[c]));
}

struct BsdfSample {
  Vec direction;
  Float weight[3];  // f cos / pdf
  Float pdf;        // per sr; undefined where `specular`
  Mask specular, alive;
};

// Sample an incident direction. `u_lobe` (two numbers) selects the lobe, `u_point` the direction in
// it.
EVS_INLINE BsdfSample sample_bsdf(const Bsdf& s, Vec d, Point2 u_lobe, Point2 u_point) {
  BsdfSample out;
  Float radius = sqrt(u_point.x), cosine, sine;
  cos_sin_turns(u_point.y, cosine, sine);
  // sample the Lambertian lobe by the cosine
  Vec local = {radius * cosine, radius * sine, sqrt(max(1.0f - u_point.x, splat(0.0f)))};
  Mask specular_lobe = u_lobe.y < s.specular_probability;
  if (any(specular_lobe)) {
    Vec bounced = sample_visible_normal(s, d, u_point.x, cosine, sine);
    local = select(specular_lobe, bounced, local);
  }
  // transform it to the camera frame, or reflect it in the perfect mirror
  Vec w = s.x * local.x + s.y * local.y + s.normal * local.z;
  Vec image = d - s.normal * (dot(d, s.normal) * 2.0f);
  out.specular = u_lobe.x < s.mirror_probability;
  out.direction = normalize(select(out.specular, image, w));
  // evaluate its pdf and weight
  BsdfValue v = evaluate_bsdf(s, d, out.direction);
  out.pdf = v.pdf;
  const Float mirror_weight = s.mirror / max(s.mirror_probability, splat(1e-20f));
  Float inverse = 1.0f / max(v.pdf, splat(1e-20f));
  for (int c = 0; c < 3; c++) {
    out.weight[c] = select(out.specular, mirror_weight, v.f_cos[c] * inverse);
  }
  out.alive = out.specular | (v.pdf > 1e-12f);
  return out;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
