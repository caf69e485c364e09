// The light of a glowing geom whose radiance is the same everywhere, without shadows, in closed
// form: of a sphere (Lagarde & de Rousiers 2014, after Snyder 1996), and of a box or rectangle by
// Lambert's formula for the irradiance from a polygon, clipped to the horizon.
#pragma once

#include "render/shading/bsdf.inl"
#include "scene/path_scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Is the light of such a geom known in closed form?
EVS_INLINE bool has_closed_form(const Emitter& e, const Geom& g) {
  return e.uniform && (g.shape == SPHERE || g.shape == BOX || g.shape == PLANE);
}

// The angle, 0 ... 1/2 turn, whose sine and cosine are in this proportion, sine >= 0; Abramowitz &
// Stegun 4.4.50, error 2e-8 rad. Of small angles the relative error is as small.
EVS_INLINE Float turns_of(Float sine, Float cosine) {
  Float size = abs(cosine);
  Mask steep = sine > size;
  Float ratio = min(sine, size) / max(max(sine, size), splat(1e-30f)), q = ratio * ratio;
  Float series = q * 0.0028662257f - 0.0161657367f;
  series = series * q + 0.0429096138f;
  series = series * q - 0.0752896400f;
  series = series * q + 0.1065626393f;
  series = series * q - 0.1420889944f;
  series = series * q + 0.1999355085f;
  series = series * q - 0.3333314528f;
  Float angle = (series * q + 1.0f) * ratio * 0.159154943f;
  angle = select(steep, 0.25f - angle, angle);
  return select(cosine < 0.0f, 0.5f - angle, angle);
}

// The integral of Lambert's formula along an edge: its angle times the cosine between `normal` and
// the normal of the plane through it, over 2 pi. In: the edge's ends from the point that is lit.
EVS_INLINE Float edge_integral(Vec a, Vec b, Vec normal) {
  Vec across = cross(a, b);
  Float size = sqrt(dot(across, across));
  return turns_of(size, dot(a, b)) * dot(across, normal) / max(size, splat(1e-30f));
}

// A corner of a polygon, from the point that is lit, and its height above the horizon.
struct Corner {
  Vec at;
  Float height;
};

// Sums the edges of a convex polygon, clipped to the horizon of `normal`.
struct PolygonIrradiance {
  Vec normal;
  Float sum = splat(0.0f);
  Vec rising = {sum, sum, sum}, setting = rising;  // where edges cross the horizon
  Mask crossed = mask_from_bits(0);

  // Add the edge from a to b where `way` is 1, from b to a where it is -1.
  EVS_INLINE void add(const Corner& a, const Corner& b, Float way) {
    Mask below_a = a.height < 0.0f, below_b = b.height < 0.0f;
    Mask forth = way > 0.0f, back = way < 0.0f, above = (forth | back) & ~(below_a & below_b);
    if (!any(above)) return;
    Vec from = a.at, to = b.at;
    Mask crosses = above & (below_a | below_b);
    if (any(crosses)) {
      Float part = a.height / select(crosses, a.height - b.height, splat(1.0f));
      Vec at = from + (to - from) * part;
      Mask rises = crosses & ((forth & below_a) | (back & below_b));
      rising = select(rises, at, rising);
      setting = select(crosses & ~rises, at, setting);
      crossed = crossed | crosses;
      from = select(crosses & below_a, at, from);
      to = select(crosses & below_b, at, to);
    }
    sum = select(above, sum + edge_integral(from, to, normal) * way, sum);
  }
  // Close it along the horizon.
  EVS_INLINE Float total() const {
    Float closed = sum;
    if (any(crossed))
      closed = select(crossed, sum + edge_integral(setting, rising, normal), closed);
    return max(closed, splat(0.0f));
  }
};

// Irradiance from a sphere. In: from the point to its centre.
inline Float irradiance_of_sphere(float radius, Vec apart, Vec normal) {
  Float zero = splat(0.0f), square = dot(apart, apart), reach = splat(radius * radius);
  Float sine2 = reach / max(square, splat(1e-30f));
  Float cosine = dot(apart, normal) / sqrt(max(square, splat(1e-30f)));
  Float out = sine2 * max(cosine, zero);
  Mask outside = square > reach, partly = outside & (cosine * cosine < sine2);
  if (any(partly)) {
    // a part of the sphere is below the horizon
    Float x = sqrt(max(1.0f / sine2 - 1.0f, zero));
    Float sine = sqrt(max(1.0f - cosine * cosine, splat(1e-12f)));
    Float y = max(min(-x * cosine / sine, splat(1.0f)), splat(-1.0f));
    Float width = sqrt(max(1.0f - y * y, zero)), end = sine * width;
    Float part = cosine * turns_of(width, y) * 2.0f - x * end * (1.0f / PI);
    part = part * sine2 + turns_of(end, x) * 2.0f;
    out = select(partly, max(part, zero), out);
  }
  return select(outside, out, zero);
}

// Irradiance from a box or the front of a rectangle, by its outline. In: from the point to the
// centre.
inline Float irradiance_of_box(const Geom& g, Vec apart, Vec normal) {
  const bool flat = g.shape == PLANE;
  const float half[3] = {g.size[0], g.size[1], flat ? 0.0f : g.size[2]};
  const float* r = g.rotation;
  // the point's height above the two sides along each axis; those of a rectangle are below it
  Vec axes[3];
  Float above[2][3];
  for (int a = 0; a < 3; a++) {
    Vec axis = splat(V3{r[a], r[3 + a], r[6 + a]});
    axes[a] = axis * splat(half[a]);
    Float height = -dot(apart, axis);
    bool sides = !flat || a == 2;
    above[0][a] = flat ? splat(-1.0f) : -height - half[a];
    above[1][a] = sides ? height - half[a] : splat(-1.0f);
  }
  Float one = splat(1.0f), zero = splat(0.0f), out = zero;
  // the angles of a distant one's edges are too small to be subtracted
  constexpr float FAR = 256;
  float reach = half[0] * half[0] + half[1] * half[1] + half[2] * half[2];
  Float square = max(dot(apart, apart), splat(1e-30f));
  Mask distant = square > FAR * FAR * reach;
  if (any(distant)) {
    for (int a = 0; a < 3; a++) {
      float area = 4 * half[(a + 1) % 3] * half[(a + 2) % 3];
      Vec side = select(above[1][a] > 0.0f, apart + axes[a], apart - axes[a]);
      Float inverse = 1.0f / max(dot(side, side), splat(1e-30f));
      Float facing = max(max(above[0][a], above[1][a]), zero) * max(dot(side, normal), zero);
      out = out + facing * inverse * inverse * (area / PI);
    }
    if (!any(~distant)) return out;
  }
  Corner corners[8];
  for (int k = 0; k < 8; k++) {
    Vec at = apart;
    for (int a = 0; a < 3; a++) at = k >> a & 1 ? at + axes[a] : at - axes[a];
    corners[k] = {at, dot(at, normal)};
  }
  // edges between a side that looks at the point and one that does not
  PolygonIrradiance polygon = {normal};
  auto seen = [&](int side, int a) { return select(above[side][a] > 0.0f, one, zero); };
  for (int a = 0; a < 3; a++) {
    int b = (a + 1) % 3, c = (a + 2) % 3;
    for (int k = 0; k < 4; k++) {
      int i = k & 1, j = k >> 1, low = i << a | j << b;
      Float way = (seen(j, b) - seen(i, a)) * (i == j ? 1.0f : -1.0f);
      polygon.add(corners[low], corners[low | 1 << c], way);
    }
  }
  return select(distant, out, polygon.total());
}

// Irradiance over pi that a surface receives from a geom of radiance 1, where there is a closed
// form: what white paper reflects.
inline Float emitter_irradiance(const Geom& g, Vec point, Vec normal) {
  Vec apart = splat(g.position) - point;
  if (g.shape == SPHERE) return irradiance_of_sphere(g.size[0], apart, normal);
  return irradiance_of_box(g, apart, normal);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
