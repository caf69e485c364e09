// How the `path` integrator's surfaces scatter light. All in one: a perfect mirror of share
// `reflectance`; of the rest a glossy lobe, GGX of width alpha with reflectance f0 at every angle,
// and Lambert's with what the gloss leaves over of the albedo.
//
// GGX with the Smith shadowing of Walter et al. 2007, directions drawn from the visible normals
// (Heitz 2018) as Dupuy & Benyoub 2023 do it. f(a, b) = f(b, a), and no more leaves than comes.
#pragma once

#include "shading/microfacet.inl"
#include "shading/surface_interaction.inl"

namespace evs::EVS_SPACE {
namespace {

constexpr float PI = 3.14159265f;

// Axes across the unit normal n (Duff et al. 2017).
EVS_INLINE void axes_of(Vec n, Vec& x, Vec& y) {
  Float sign = select(n.z < 0.0f, splat(-1.0f), splat(1.0f));
  Float a = -1.0f / (sign + n.z), b = n.x * n.y * a;
  x = {sign * n.x * n.x * a + 1.0f, sign * b, -(sign * n.x)};
  y = {b, sign + n.y * n.y * a, -n.y};
}

struct Scattering {
  Vec normal, x, y;
  Float outgoing;  // cosine towards the eye, over 0
  Float alpha;     // width of the glossy lobe
  Float gloss[3], diffuse[3];
  Float mirror;  // share of the perfect mirror
  Float glossy;  // probability of the glossy lobe where it is not the mirror
};

// Toward the eye is -d.
EVS_INLINE Scattering scattering_of(const Patch<3>& patch, Vec d) {
  Scattering s;
  s.normal = patch.normal;
  axes_of(s.normal, s.x, s.y);
  s.outgoing = max(-dot(d, s.normal), splat(1e-4f));
  // narrower than this it is a mirror to single precision
  s.alpha = min(max(patch.alpha_ggx, splat(0.002f)), splat(1.0f));
  s.mirror = min(max(patch.reflectance, splat(0.0f)), splat(1.0f));
  Float gloss = splat(0.0f), diffuse = splat(0.0f);
  Float rest = 1.0f - s.mirror;
  for (int c = 0; c < 3; c++) {
    Float f0 = min(max(patch.f0[c], splat(0.0f)), splat(1.0f));
    s.gloss[c] = rest * f0;
    s.diffuse[c] = rest * max(patch.albedo[c], splat(0.0f)) * (1.0f - patch.metallic) * (1.0f - f0);
    gloss = gloss + s.gloss[c];
    diffuse = diffuse + s.diffuse[c];
  }
  Float share = gloss / max(gloss + diffuse, splat(1e-20f));
  share = max(min(share, splat(0.9f)), splat(0.1f));
  s.glossy = select(gloss > 0.0f, select(diffuse > 0.0f, share, splat(1.0f)), splat(0.0f));
  return s;
}

// Smith's shadowing of one direction, for a cosine over 0.
EVS_INLINE Float shadowing(Float cosine, Float alpha) {
  Float square = alpha * alpha;
  return 2.0f * cosine / (cosine + sqrt(square + (1.0f - square) * cosine * cosine));
}

struct Value {
  Float light[3];  // f times the cosine of w, the mirror left out
  Float density;   // with which `scatter` draws w, but for the mirror, per sr
};

EVS_INLINE Value evaluate(const Scattering& s, Vec d, Vec w) {
  Value v;
  Float incoming = dot(w, s.normal);
  Mask above = incoming > 0.0f;
  Float cosine = max(incoming, splat(0.0f));
  // D G(eye) / (4 cos(eye)) is the density of drawing w; times G(w) F it is f cos
  Float facing = facets(s.normal, normalize(w - d), s.alpha) * (1.0f / PI);
  Float drawn = facing * shadowing(s.outgoing, s.alpha) / (s.outgoing * 4.0f);
  Float gloss = drawn * shadowing(max(cosine, splat(1e-6f)), s.alpha);
  Float lambert = cosine * (1.0f / PI);
  for (int c = 0; c < 3; c++) {
    v.light[c] = select(above, s.gloss[c] * gloss + s.diffuse[c] * lambert, splat(0.0f));
  }
  Float either = s.glossy * drawn + (1.0f - s.glossy) * lambert;
  v.density = select(above, (1.0f - s.mirror) * either, splat(0.0f));
  return v;
}

struct Scattered {
  Vec direction;
  Float throughput[3];  // f cos / probability density
  Float density;        // per sr; of no meaning where `mirrored`
  Mask mirrored, alive;
};

// A direction that light may come from. `choice` (two numbers) picks the lobe, `point` its place.
EVS_INLINE Scattered scatter(const Scattering& s, Vec d, Pair choice, Pair point) {
  Scattered out;
  Float radius = sqrt(point.x), cosine, sine;
  circle(point.y, cosine, sine);
  // Lambert
  Vec local = {radius * cosine, radius * sine, sqrt(max(1.0f - point.x, splat(0.0f)))};
  Mask glossy = choice.y < s.glossy;
  if (any(glossy)) {
    // a visible facet: uniform on the cap of the sphere that the stretched eye direction sees
    Vec eye = {-dot(d, s.x), -dot(d, s.y), s.outgoing};
    Vec stretched = normalize({eye.x * s.alpha, eye.y * s.alpha, eye.z});
    Float z = (1.0f - point.x) * (1.0f + stretched.z) - stretched.z;
    Float ring = sqrt(min(max(1.0f - z * z, splat(0.0f)), splat(1.0f)));
    Vec cap = {ring * cosine + stretched.x, ring * sine + stretched.y, z + stretched.z};
    Vec facet = normalize({cap.x * s.alpha, cap.y * s.alpha, max(cap.z, splat(1e-7f))});
    Vec bounced = facet * (2.0f * dot(facet, eye)) - eye;
    local = select(glossy, bounced, local);
  }
  Vec w = s.x * local.x + s.y * local.y + s.normal * local.z;
  Vec image = d - s.normal * (dot(d, s.normal) * 2.0f);
  out.mirrored = choice.x < s.mirror;
  out.direction = normalize(select(out.mirrored, image, w));
  Value v = evaluate(s, d, out.direction);
  out.density = v.density;
  // the mirror is chosen with its own share, which cancels
  Float inverse = 1.0f / max(v.density, splat(1e-20f));
  for (int c = 0; c < 3; c++) {
    out.throughput[c] = select(out.mirrored, splat(1.0f), v.light[c] * inverse);
  }
  out.alive = out.mirrored | (v.density > 1e-12f);
  return out;
}

}  // namespace
}  // namespace evs::EVS_SPACE
