// Outlines of the analytic shapes: how much of what a camera ray stands for a shape covers, in
// closed form. Light at a silhouette then changes as its outline moves, not as samples pass it.
//
// A ray stands for its cell, the pixel or a square part of it. There an outline is taken for a
// straight line, so a corner is the intersection of two. What bends within a cell needs more
// samples.
#pragma once

#include "render/geometry/shapes.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Rays through the middles of cells. Over a cell they turn to the right by `x` and upwards by `y`.
struct CellRays {
  Vec direction;  // unit
  Float x, y;
};

// The part of a cell that a shape covers.
struct Coverage {
  Float share = splat(1.0f);
  Float x = splat(0.0f), y = splat(0.0f);  // from the middle to the middle of that part, cells
  Float slope_x = splat(0.0f), slope_y = splat(0.0f);  // of its outline, which is unit
  Float distance = splat(0.0f);                        // of a ray that passes by
};

EVS_INLINE Coverage choose(Mask m, const Coverage& a, const Coverage& b) {
  return {select(m, a.share, b.share),
          select(m, a.x, b.x),
          select(m, a.y, b.y),
          select(m, a.slope_x, b.slope_x),
          select(m, a.slope_y, b.slope_y),
          select(m, a.distance, b.distance)};
}

// How much the parts of two outlines have in common: nested if they face the same way, apart if
// they face each other.
EVS_INLINE Float common_share(Float a, Float b, Float cosine) {
  Float product = a * b;
  Float nested = min(a, b) - product, apart = max(a + b - 1.0f, splat(0.0f)) - product;
  return product + nested * max(cosine, splat(0.0f)) + apart * max(-cosine, splat(0.0f));
}

// The share that a surface covers of what one before it leaves of a cell.
EVS_INLINE Float uncovered_share(const Coverage& before, const Coverage& c) {
  Float cosine = before.slope_x * c.slope_x + before.slope_y * c.slope_y;
  Float both = common_share(before.share, c.share, cosine);
  Float share = (c.share - both) / max(1.0f - before.share, splat(1e-6f));
  return select(c.share < 1.0f, min(max(share, splat(0.0f)), splat(1.0f)), splat(1.0f));
}

// A shape under cells.
struct Outline {
  const float* rotation;  // of the geom
  const CellRays& cells;
  float reach;  // half a cell's diagonal, or more
  Vec d;        // of the cells, in the geom's frame
  Coverage covered;

  // Cut off what lies beyond a line: where height + dot(gradient, turn) is below 0, if rays turn.
  // Returns the lanes where it leaves least.
  EVS_INLINE Mask cut(Float height, Vec gradient, Mask lanes) {
    Coverage& c = covered;
    Mask near = height * height < dot(gradient, gradient) * (reach * reach);
    c.share = select(lanes & ~near & (height < 0.0f), splat(0.0f), c.share);
    near = near & lanes;
    if (!any(near)) return near;
    const float* r = rotation;
    Float along = (gradient.x * r[0] + gradient.y * r[1] + gradient.z * r[2]) * cells.x;
    Float up = (gradient.x * r[3] + gradient.y * r[4] + gradient.z * r[5]) * cells.y;
    Float a = abs(along), b = abs(up);
    Float wide = max(max(a, b), splat(1e-30f)), narrow = max(min(a, b), wide * 1e-4f);
    // the smaller side: a triangle, or a strip and a triangle
    Float half = (wide + narrow) * 0.5f, depth = half - abs(height);
    Float corner = depth * depth * 0.5f / (wide * narrow);
    Float strip = (depth - narrow * 0.5f) / wide;
    Float smaller = select(depth < narrow, corner, strip);
    smaller = select(depth > 0.0f, smaller, splat(0.0f));
    Float share = select(height > 0.0f, 1.0f - smaller, smaller);
    Float square = max(a * a + b * b, splat(1e-30f));
    Float shift = select(near & (depth > 0.0f), (half - height) * 0.5f / square, splat(0.0f));
    c.x = c.x + along * shift;
    c.y = c.y + up * shift;
    Float unit = 1.0f / sqrt(square);
    Float slope_x = along * unit, slope_y = up * unit;
    Float both = common_share(c.share, share, slope_x * c.slope_x + slope_y * c.slope_y);
    Mask least = near & (share < c.share);
    c.slope_x = select(least, slope_x, c.slope_x);
    c.slope_y = select(least, slope_y, c.slope_y);
    c.share = select(near, both, c.share);
    return least;
  }

  // Both sides of a round outline: `off` leads from the axis or centre to the ray where it is
  // nearest, at `t`. In: what turns `off` into a direction of the geom's frame.
  template <class Unscale>
  EVS_INLINE void cut_round(float radius, Vec off, Float t, Unscale unscale) {
    Mask all = mask_from_bits(ALL_LANES);
    Float away = sqrt(max(dot(off, off), splat(1e-30f)));
    Vec gradient = unscale(off) * (t / -away);
    covered.distance = t;
    cut(radius - away, gradient, all);
    cut(radius + away, gradient * splat(-1.0f), all);
  }
  EVS_INLINE void cut_round(float radius, Vec off, Float t) {
    cut_round(radius, off, t, [](Vec v) { return v; });
  }

  EVS_INLINE void sphere(const float* size, Vec o) {
    Float t = -dot(o, d);
    cut_round(size[0], o + d * t, t);
  }

  EVS_INLINE void ellipsoid(const float* size, Vec o) {
    V3 inverse = {1.0f / size[0], 1.0f / size[1], 1.0f / size[2]};
    auto scale = [&](Vec v) { return Vec{v.x * inverse.x, v.y * inverse.y, v.z * inverse.z}; };
    Vec p = scale(o), q = scale(d);
    Float t = -dot(p, q) / dot(q, q);
    cut_round(1.0f, p + q * t, t, scale);
  }

  // Where a ray is nearest to the z axis.
  EVS_INLINE Float nearest_to_axis(Vec o) const {
    return (o.x * d.x + o.y * d.y) / -max(d.x * d.x + d.y * d.y, splat(1e-12f));
  }

  EVS_INLINE void capsule(const float* size, Vec o) {
    Float half = splat(size[1]), z = o.z + d.z * nearest_to_axis(o);
    Vec from = {o.x, o.y, o.z - max(min(z, half), -half)};
    Float t = -dot(from, d);
    cut_round(size[0], from + d * t, t);
  }

  EVS_INLINE void cylinder(const float* size, Vec o) {
    // the slope is bounded, so no point is too far away to be squared
    Float t = nearest_to_axis(o), slope = 1.0f / select(abs(d.z) < 1e-6f, splat(1e-6f), d.z);
    Vec off = {o.x + d.x * t, o.y + d.y * t, splat(0.0f)};
    cut_round(size[0], off, t);
    // the rims that end the cylinder: those of the lid where rays enter and of the one where they
    // leave, beyond and before the point that is nearest to the axis
    Float square = max(size[0] * size[0] - dot(off, off), splat(0.0f));
    Float chord = sqrt(square / max(d.x * d.x + d.y * d.y, splat(1e-12f)));
    Float a = (-size[1] - o.z) * slope, b = (size[1] - o.z) * slope;
    Float ends[2] = {min(a, b), max(a, b)};
    for (int k = 0; k < 2; k++) {
      Mask rim = k == 0 ? ends[0] > t : ends[1] < t;
      if (!any(rim)) continue;
      Float x = o.x + d.x * ends[k], y = o.y + d.y * ends[k];
      Float away = sqrt(max(x * x + y * y, splat(1e-30f)));
      Vec gradient = {x, y, (x * d.x + y * d.y) * -slope};
      Mask least = cut(size[0] - away, gradient * (ends[k] / -away), rim);
      Float end = k == 0 ? min(ends[k], t + chord) : max(ends[k], t - chord);
      covered.distance = select(least, end, covered.distance);
    }
  }

  // The outline of a box has the edges between faces that the camera sees and faces that it does
  // not see.
  EVS_INLINE void box(const float* size, V3 camera) {
    const float from[3] = {camera.x, camera.y, camera.z};
    const Float to[3] = {d.x, d.y, d.z};
    for (int i = 0; i < 3; i++) {
      const float side = from[i] < 0 ? -1.0f : 1.0f, seen = side * size[i] - from[i];
      if (seen * side >= 0) continue;
      for (int k = 0; k < 4; k++) {
        const int j = (i + 1 + k / 2) % 3;
        const float other = k % 2 ? -1.0f : 1.0f, hidden = other * size[j] - from[j];
        if (hidden * other < 0) continue;
        Float gradient[3] = {splat(0.0f), splat(0.0f), splat(0.0f)};
        gradient[i] = splat(-side * other * hidden);
        gradient[j] = splat(side * other * seen);
        Mask least = cut(to[i] * gradient[i] + to[j] * gradient[j],
                         {gradient[0], gradient[1], gradient[2]}, mask_from_bits(ALL_LANES));
        if (!any(least)) continue;
        Float square = max(to[i] * to[i] + to[j] * to[j], splat(1e-12f));
        Float t = (to[i] * seen + to[j] * hidden) / square;
        covered.distance = select(least, t, covered.distance);
      }
    }
  }

  // A plane with sides, and the horizon of one without.
  EVS_INLINE void plane(const float* size, Vec o) {
    Mask all = mask_from_bits(ALL_LANES);
    Float zero = splat(0.0f), one = splat(1.0f);
    cut(-d.z, {zero, zero, -one}, all);
    Float slope = 1.0f / min(d.z, splat(-1e-9f)), t = o.z * -slope;
    covered.distance = t;
    if (size[0] > 0) {
      Float x = o.x + d.x * t, side = select(x < 0.0f, one, -one) * t;
      cut(size[0] - abs(x), {side, zero, d.x * slope * -side}, all);
    }
    if (size[1] > 0) {
      Float y = o.y + d.y * t, side = select(y < 0.0f, one, -one) * t;
      cut(size[1] - abs(y), {zero, side, d.y * slope * -side}, all);
    }
  }

  EVS_INLINE void shape(const Geom& g, Vec o) {
    switch (g.shape) {
      case PLANE:
        return plane(g.size, o);
      case SPHERE:
        return sphere(g.size, o);
      case CAPSULE:
        return capsule(g.size, o);
      case ELLIPSOID:
        return ellipsoid(g.size, o);
      case CYLINDER:
        return cylinder(g.size, o);
      default:
        return box(g.size, g.camera);
    }
  }
};

}  // namespace
}  // namespace evs::EVS_NAMESPACE
