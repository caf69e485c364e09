// The `hybrid` integrator: light split by how fast it changes. Lamps, glowing geoms, gloss and
// mirrors are evaluated at every hit of a camera ray, as in `direct`; the diffuse light of the sky
// and of bounces is read from the irradiance cache. It is deterministic: no random numbers but
// those of the cache's nodes.
//
// Surfaces are those of `path`. What is approximated:
//  - of sky and bounces, the specular lobe reflects its share of what a diffuse surface receives;
//  - where luminance alone is rendered, the colour of a texture is its mean;
//  - bulbs and glowing geoms are points on them, the same everywhere, and all points are traced
//    only where the outermost ones are not all lit or all in shadow.
#pragma once

#include "render/integrators/antialiasing.inl"
#include "render/integrators/path.inl"
#include "render/irradiance/kept_light.inl"
#include "render/shading/emitter_irradiance.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Directional albedo of the GGX lobe for a reflectance of 1: a fit, off by at most 0.05.
EVS_INLINE Float specular_albedo(Float cosine, Float alpha) {
  Float lost = alpha * 0.3051f + cosine * (alpha * 0.6556f - 0.0889f) + 0.0673f;
  Float rest = alpha + cosine * (cosine * 0.293f - 0.0144f) + 0.0033f;
  return 1.0f - alpha * lost / rest;
}

constexpr int FEWEST_POINTS = 16;  // on each of several glowing geoms
constexpr int OUTERMOST = 8;       // points of a glowing geom that decide whether all are traced
// Cosine up to which a point of a glowing geom gives no light: rays that arrive so flat could meet
// the geom itself, by rounding, and not every packet traces them.
constexpr float GRAZING = 0.01f;

struct HybridShading {
  static constexpr int MIRRORS = 2;
  static constexpr bool KEEPS = LANES == PACKET;
  const PathFrame& p;
  const IrradianceView& cache;
  NodeRequests& requests;
  KeptWriter* keeps = nullptr;  // under a still camera

  template <int CHANNELS>
  void shade(const Frame& f, const Rays& rays, const Hit& hit,
             const SurfaceInteraction<CHANNELS>& interaction, LazyBounds& bounds, Mask lit,
             Float path_length, const CachedShading*, Float* out) const {
    SurfaceLobes<CHANNELS> s = surface_lobes(interaction, rays.direction);
    const Surfaces<CHANNELS> at = {f, rays, hit, interaction, bounds, lit, s, out};
    light_by_lamps(at);
    Received received = {};
    CacheCells cells;
    if (!cache.off) {
      cells_of_hits<CHANNELS>(f, cache, requests, rays, hit, interaction, lit, path_length, cells);
      if (requests.complete) read_cells<(CHANNELS >= 3)>(cache.light, cells, lit, received);
    }
    Float gloss = specular_albedo(min(s.geometry.cos_outgoing, splat(1.0f)), s.geometry.alpha);
    Float reflectance[CHANNELS];
    for (int c = 0; c < CHANNELS; c++) reflectance[c] = s.specular[c] * gloss + s.diffuse[c];
    if (KEEPS && keeps) keeps->shaded<CHANNELS>(cells, out, reflectance, hit, interaction, s, lit);
    for (int c = 0; c < CHANNELS; c++)
      out[c] = out[c] + reflectance[c] * of_channel<CHANNELS>(f, received, c);
  }
  // The light of lamps that a surface reflects.
  template <int CHANNELS>
  void relight(const Frame& f, const Rays& rays, const KeptSurface<CHANNELS>& kept, Mask lit,
               Float* out) const {
    LazyBounds bounds;
    light_by_lamps(
        Surfaces<CHANNELS>{f, rays, kept.hit, kept.interaction, bounds, lit, kept.lobes, out});
  }
  template <int CHANNELS>
  void mirrored(const Float* image, Mask lanes) const {
    if (KEEPS && keeps) keeps->mirrored<CHANNELS>(image, lanes);
  }
  template <int CHANNELS>
  void composited(const Float* before, Float weight, Mask lit) const {
    if (KEEPS && keeps) keeps->composited<CHANNELS>(before, weight, lit);
  }
  template <int CHANNELS>
  void sampled(const Float* light) const {
    if (KEEPS && keeps) keeps->sampled<CHANNELS>(light);
  }

 private:
  // What is shaded.
  template <int CHANNELS>
  struct Surfaces {
    const Frame& f;
    const Rays& rays;
    const Hit& hit;
    const SurfaceInteraction<CHANNELS>& interaction;
    LazyBounds& bounds;
    Mask lit;
    const SurfaceLobes<CHANNELS>& s;
    Float* out;

    EVS_INLINE Mask facing(Vec wi) const {
      return lit & (dot(wi, interaction.normal) > 0.0f) &
             (dot(wi, interaction.geometric_normal) > 0.0f);
    }

    EVS_INLINE Mask glossy() const {
      Mask found = mask_from_bits(0);
      for (int c = 0; c < CHANNELS; c++) found = found | (s.specular[c] > 0.0f);
      return found;
    }

    // Evaluate the lobes for light from wi, times pi, for a reflectance of 1.
    EVS_INLINE void lobes(Vec wi, Mask lanes, Float& specular, Float& cosine) const {
      cosine = max(dot(wi, s.geometry.normal), splat(0.0f));
      specular = splat(0.0f);
      if (any(glossy() & lanes)) {
        specular = visible_normal_pdf(s.geometry, rays.direction, wi) *
                   smith_g1(max(cosine, splat(1e-6f)), s.geometry.alpha) * PI;
      }
    }
  };

  // The lanes from which a box cannot hide a sphere, as both are beyond one of its sides.
  template <int CHANNELS>
  EVS_INLINE Mask beyond(const Surfaces<CHANNELS>& at, const Geom& g, V3 center,
                         float radius) const {
    constexpr float ROUNDING = 1e-5f;
    Mask found = mask_from_bits(0);
    const float* r = g.rotation;
    Vec start = at.interaction.spawn_point - splat(g.position);
    for (int a = 0; a < 3; a++) {
      V3 axis = {r[a], r[3 + a], r[6 + a]};
      float place = dot(center - g.position, axis), reach = g.size[a];
      if (__builtin_fabsf(place) - radius < reach * (1 + ROUNDING)) continue;
      Float height = dot(start, splat(axis)) * (place < 0 ? -1.0f : 1.0f);
      found = found | (height >= reach * (1 - ROUNDING) - ROUNDING * at.hit.distance);
    }
    return found;
  }

  // Does a box lie beside the rays from the sphere where a cone begins to another sphere? In: the
  // other sphere.
  EVS_INLINE static bool aside(const Geom& g, const RayCone& cone, V3 center, float radius) {
    V3 v = g.position - cone.center;
    V3 away = normalized(v - scaled(cone.axis, dot(v, cone.axis)));
    const float* r = g.rotation;
    float reach = 0;
    for (int a = 0; a < 3; a++)
      reach += g.size[a] * __builtin_fabsf(r[a] * away.x + r[3 + a] * away.y + r[6 + a] * away.z);
    float near = dot(v, away) - reach, end = dot(center - cone.center, away) + radius;
    float widest = cone.radius > end ? cone.radius : end;
    return near > widest * 1.0001f + 1e-5f * cone.length;
  }

  // The rays from points in a box to a lamp, a sphere. Returns false where points lie in it.
  EVS_INLINE static bool cone_to_lamp(const BoundingBox& box, V3 position, float radius,
                                      RayCone& cone) {
    cone = bounding_sphere(box);
    cone.radius += box.step;
    V3 w = position - cone.center;
    float distance = __builtin_sqrtf(dot(w, w));
    cone.axis = normalized(w);
    cone.length = distance + radius;
    if (!(radius > cone.radius)) return true;
    if (!(distance > radius)) return false;
    cone.sine = (radius - cone.radius) / distance;
    cone.cosine = __builtin_sqrtf(1 - cone.sine * cone.sine);
    return true;
  }

  // Call visit(geom, cone, lanes) for the geoms that may hide a lamp, a sphere, from the points of
  // `lanes`, until it returns true: those near the rays from a box of points to the sphere; convex
  // ones never hide it from themselves. `lamp`: a geom, or -1. Returns whether one returned true,
  // or whether a point lies in the sphere.
  template <int CHANNELS, class Visit>
  bool visit_hiding(const Surfaces<CHANNELS>& at, V3 position, float radius, int lamp, Mask lanes,
                    const Visit& visit) const {
    const Frame& f = at.f;
    RayCone cone;
    if (!cone_to_lamp(at.bounds.of(at.interaction, at.lit), position, radius, cone)) return true;
    auto consider = [&](int index, const RayCone& near, Mask points) {
      const Geom& g = f.geoms[index];
      bool mesh = g.shape == MESH || g.shape == HFIELD;
      if (index == lamp && !mesh) return false;
      points = lanes_to_test(f, index, at.hit.geom, points);
      if (!any(points)) return false;
      const float* r = g.rotation;
      // only the front of a plane stops rays
      V3 up = {r[2], r[5], r[8]};
      if (g.shape == PLANE && dot(position - g.position, up) > radius * 1.00001f) return false;
      return visit(index, near, points);
    };
    for (int k = 0, end = candidates_end(f, cone); k < end; k += LANES) {
      for (unsigned near = candidates(f, k, end, cone); near; near &= near - 1) {
        if (consider(k + first_lane(near), cone, lanes)) return true;
      }
    }
    if (f.bvh.top == 0 || !cone_may_touch(f.finite_bounds, cone)) return false;
    // many geoms: go by bundles of points that lie near each other
    Vec start = at.interaction.spawn_point;
    while (any(lanes)) {
      int i = first_lane(to_bits(lanes));
      Vec apart = start - splat(V3{lane(start.x, i), lane(start.y, i), lane(start.z, i)});
      Mask bundle = lanes & (dot(apart, apart) <= f.bvh.fine * f.bvh.fine);
      bundle = bundle | mask_from_bits(1u << i);
      lanes = lanes & ~bundle;
      BoundingBox box = bounding_box(start, at.interaction.step, bundle);
      if (!cone_to_lamp(box, position, radius, cone)) return true;
      GeomSet found;
      find_geoms(f.bvh, cone, found);
      bool stopped = false;
      found.visit([&](int index) { return stopped = consider(index, cone, bundle); });
      if (stopped) return true;
    }
    return false;
  }

  // The part of a unit disc on one side of a line at t, -1 ... 1, off its middle: a fit.
  EVS_INLINE static Float part_of_disc(Float t) {
    Float square = t * t;
    return t * (square * (square * -0.0523f - 0.0807f) + 0.633f) + 0.5f;
  }

  // How much of a bulb a geom hides, where that is known in closed form.
  struct Cover {
    Mask dark, partly;  // all of it, a part of it
    Float share;        // where `partly`
    Mask unknown;
  };

  // The geoms that may hide a bulb, and from which points.
  struct Hiders {
    static constexpr int ROOM = 32;
    int count = 0;
    bool all = true;
    int geoms[ROOM];
    Mask lanes[ROOM];

    void add(int geom, Mask from) {
      if (!any(from)) return;
      int i = 0;
      while (i < count && geoms[i] != geom) i++;
      if (i == ROOM) {
        all = false;
        return;
      }
      lanes[i] = i == count ? from : lanes[i] | from;
      geoms[i] = geom;
      count = i == count ? i + 1 : count;
    }
  };

  // The lanes whose rays to a bulb meet a geom's bounding sphere. It is exact but for rounding: the
  // sphere is found in every packet of such a lane.
  template <int CHANNELS>
  EVS_INLINE Mask may_hide(const Surfaces<CHANNELS>& at, int index, const Incidence& in, float bulb,
                           Mask lanes) const {
    const BoundingSphereArray& b = at.f.bounds;
    float radius = b.radius[index];
    Vec v = splat(V3{b.x[index], b.y[index], b.z[index]}) - at.interaction.spawn_point;
    Float along = dot(v, in.wi);
    Vec off = v - in.wi * along, beyond = v - in.wi * in.distance;
    Float aside = sqrt(dot(off, off)), sine = bulb / in.distance;
    Float cosine = sqrt(max(1.0f - sine * sine, splat(0.0f)));
    // the point of the cone's side nearest to the sphere
    Float foot = along * cosine + aside * sine, away = aside * cosine - along * sine;
    Mask beside = (foot > 0.0f) & (foot < in.distance * cosine) & (away <= radius);
    float reach = radius + bulb;
    return lanes &
           (beside | (dot(v, v) <= radius * radius) | (dot(beyond, beyond) <= reach * reach));
  }

  // Cover of a bulb by a sphere or a capsule. The outline of the geom is taken for a circle, or
  // along a capsule for two lines, and the bulb for a disc. A round outline not much wider than the
  // bulb is left `unknown`.
  template <int CHANNELS>
  Cover cover_of(const Surfaces<CHANNELS>& at, const Geom& g, const Incidence& in, float bulb,
                 Vec center, float radius, bool capsule, Mask lanes) const {
    constexpr float WIDE = 1.5f;  // bulbs
    Vec v = center - at.interaction.spawn_point;
    Mask along_axis = mask_from_bits(0);
    if (capsule) {
      // the point of the axis nearest to the ray
      const float* r = g.rotation;
      Vec u = splat(V3{r[2], r[5], r[8]});
      Float b = dot(in.wi, u), ahead = dot(in.wi, v), up = dot(u, v);
      Float between = max(1.0f - b * b, splat(1e-6f));
      Float s = (ahead * b - up) / between;
      // behind the start of the ray, the one nearest to the start
      s = select((ahead + b * s) > 0.0f, s, -up);
      along_axis = abs(s) < splat(g.size[1]);
      v = v + u * min(max(s, splat(-g.size[1])), splat(g.size[1]));
    }
    Float square = dot(v, v), along = dot(v, in.wi);
    Vec off = v - in.wi * along;
    // the sine of the angle by which the outline reaches beyond the middle of the bulb
    Float inverse = 1.0f / max(square, splat(1e-20f));
    Float beside = sqrt(max(square - radius * radius, splat(0.0f))) * sqrt(dot(off, off)) * inverse;
    Float before = along * radius * inverse, width = bulb / in.distance;
    Float t = (before - beside) / width, t_far = (before + beside) / width;
    // rays that start inside leave; and what is behind the bulb hides nothing
    Mask between = lanes & (square > radius * radius) & (along > 0.0f) & (along < in.distance);
    Cover out;
    out.dark = between & (t >= 1.0f);
    out.partly = between & ~out.dark & (t > -1.0f);
    Float wide = splat(radius) * sqrt(inverse) / width;
    out.unknown = out.partly & (wide < WIDE) & ~along_axis;
    // the part of a disc on one side of a line, less what lies beyond the arc of the outline
    Float chord = sqrt(max(1.0f - t * t, splat(0.0f)));
    Float beyond_arc = chord * chord * chord * 0.1061f / max(wide, splat(WIDE));
    // a capsule also ends on the other side
    Float beyond_side = 1.0f - part_of_disc(min(t_far, splat(1.0f)));
    out.share = part_of_disc(t) - select(along_axis, beyond_side, beyond_arc);
    return out;
  }

  // Cover by a plane in which a bulb is sunk. It must reach beyond the bulb.
  template <int CHANNELS>
  Cover cover_of_plane(const Surfaces<CHANNELS>& at, const Geom& g, const Light& light,
                       const Incidence& in, Mask lanes) const {
    const float* r = g.rotation;
    V3 up = {r[2], r[5], r[8]}, v = light.position - g.position;
    float height = dot(v, up), x = dot(v, {r[0], r[3], r[6]}), y = dot(v, {r[1], r[4], r[7]});
    auto inside = [&](float size, float place) {
      return size <= 0 || __builtin_fabsf(place) + 2 * light.radius < size;
    };
    // only its front stops rays
    Mask front = lanes & (dot(at.interaction.spawn_point - splat(g.position), splat(up)) > 0.0f);
    Mask none = mask_from_bits(0);
    Cover out = {none, none, splat(0.0f), front};
    if (!inside(g.size[0], x) || !inside(g.size[1], y)) return out;
    out.unknown = none;
    // The plane cuts a cap off the sphere. Its rim is seen as an ellipse, which touches the outline
    // where the cap reaches beyond it: of the outline's disc, the hidden part ends at a chord, less
    // or more a part of the ellipse.
    Float one = splat(1.0f), facing = dot(in.wi, splat(up));
    float k = height / light.radius, rim = 1 - k * k;
    if (rim <= 0) {
      out.dark = k < 0 ? front : out.dark;
      return out;
    }
    Float slant = sqrt(max(1.0f - facing * facing, splat(1e-12f)));
    Float chord = max(min(splat(k) / slant, one), -one);
    Float on_ellipse = splat(k / __builtin_sqrtf(rim)) * abs(facing) / slant;
    Float arc = part_of_disc(-max(min(on_ellipse, one), -one));
    out.share = part_of_disc(-chord) + facing * rim * select(facing < 0.0f, arc, 1.0f - arc);
    out.partly = front & (out.share > 0.0f);
    return out;
  }

  // The share of a bulb that is seen from each point of `facing`.
  template <int CHANNELS>
  Float bulb_visibility(const Surfaces<CHANNELS>& at, const Light& light, const Incidence& in,
                        Mask facing) const {
    const Frame& f = at.f;
    Float seen = splat(1.0f);
    Mask dark = mask_from_bits(0), partly = dark, unknown = dark;
    // near the bulb it is not
    Mask near = facing & (in.distance < 2 * light.radius);
    Hiders hiders;
    auto hide = [&](int index, const RayCone&, Mask lanes) {
      const Geom& g = f.geoms[index];
      lanes = lanes & (~dark | near);
      if (g.shape == BOX) lanes = lanes & ~beyond(at, g, light.position, light.radius);
      lanes = may_hide(at, index, in, light.radius, lanes);
      if (!any(lanes)) return false;
      hiders.add(index, lanes);
      bool outline = g.shape == SPHERE || g.shape == CAPSULE || g.shape == PLANE;
      if (!outline || (p.transparent && is_transparent(f, index))) {
        unknown = unknown | lanes;
        return false;
      }
      Cover cover = g.shape == PLANE ? cover_of_plane(at, g, light, in, lanes)
                                     : cover_of(at, g, in, light.radius, splat(g.position),
                                                g.size[0], g.shape == CAPSULE, lanes);
      dark = dark | cover.dark;
      // What two geoms hide together is not known. Of many geoms, other packets may miss one that
      // is near, but hides nothing: what it decides must not matter.
      unknown = unknown | cover.unknown | (f.bvh.top > 0 ? cover.partly : cover.partly & partly);
      partly = partly | cover.partly;
      seen = select(cover.partly, 1.0f - cover.share, seen);
      return false;
    };
    bool inside = visit_hiding(at, light.position, light.radius, -1, facing, hide);
    hiders.all = hiders.all && !inside;
    dark = dark & ~near;
    unknown = inside ? facing : (unknown & ~dark) | near;
    seen = select(dark, splat(0.0f), seen);
    if (!any(unknown)) return seen;
    // rays to points of the bulb: all of them only where the first ones are not alike
    Float sum = splat(0.0f);
    auto ray = [&](int k, Mask traced) {
      // the first ones lie on the rim
      constexpr float RIM = 0.97f, CENTRE = 0.5f / BULB_POINTS - 0.5f / LAMP_POINTS;
      Point2 u = {
          splat(k < 0 ? RIM : cache.lamp_x[k] + CENTRE),
          splat(k < 0 ? static_cast<float>(-1 - k) * 0.25f + 0.125f : cache.lamp_y[k] + CENTRE)};
      Float distance;
      Vec wi = sample_cone(in.wi, in.distance, light.radius, u, p.world, distance);
      distance = max(distance, splat(0.0f));
      if (!hiders.all) {
        return transmittance(f, p, at.interaction.spawn_point, wi, distance, at.hit.geom, traced,
                             light.non_occluders, nullptr);
      }
      Mask blocked = mask_from_bits(0);
      Rays rays = {at.interaction.spawn_point, wi, false};
      bool layers = false;
      for (int i = 0; i < hiders.count; i++) {
        Mask tested = hiders.lanes[i] & traced & ~blocked;
        if (!any(tested)) continue;
        if (p.transparent && is_transparent(f, hiders.geoms[i])) {
          layers = true;
        } else {
          occlude(f, hiders.geoms[i], rays, distance, tested, blocked);
        }
      }
      traced = traced & ~blocked;
      if (!layers) return select(traced, splat(1.0f), splat(0.0f));
      return through_geoms(f, p, rays, distance, at.hit.geom, traced);
    };
    constexpr int ON_RIM = 4, FIRST = 4;
    Float rim = splat(0.0f);
    for (int k = 0; k < ON_RIM; k++) rim = rim + ray(-1 - k, unknown);
    for (int k = 0; k < FIRST; k++) sum = sum + ray(k, unknown);
    Float first = rim + sum;
    Mask left = unknown & (first > 0.0f) & (first < static_cast<float>(ON_RIM + FIRST));
    if (any(left)) {
      for (int k = FIRST; k < BULB_POINTS; k++) sum = sum + ray(k, left);
    }
    Float share = select(left, sum * (1.0f / BULB_POINTS), first * (1.0f / (ON_RIM + FIRST)));
    return select(unknown, share, seen);
  }

  template <int CHANNELS>
  void light_by_lamps(const Surfaces<CHANNELS>& at) const {
    for (int c = 0; c < CHANNELS; c++) at.out[c] = at.interaction.emitted[c];
    visit_lights(at.f, 0, at.f.light_count, at.interaction, at.bounds, at.lit, [&](int i) {
      if (!at.f.lights[i].is_image()) add_light(at, at.f.lights[i]);
    });
    for (int e = 0; e < p.emitter_count; e++) add_emitter(at, e);
  }

  template <int CHANNELS>
  void add_light(const Surfaces<CHANNELS>& at, const Light& light) const {
    const Frame& f = at.f;
    const SurfaceInteraction<CHANNELS>& interaction = at.interaction;
    Incidence in = incidence(light, interaction.point);
    // the ambient light of directional lights is a sky
    if (!light.is_delta_direction()) {
      Float share = select(at.lit, in.strength, splat(0.0f));
      for (int c = 0; c < CHANNELS; c++)
        at.out[c] = at.out[c] + (at.s.diffuse[c] + at.s.specular[c]) * share * light.ambient[c];
    }
    Mask facing = at.facing(in.wi) & (in.strength > 0.0f);
    Float strength = in.strength;
    bool casts = light.castshadow && f.shadows, bulb = light.is_bulb();
    if (bulb) {
      facing = facing & (in.distance > light.radius);
      float inverse = 1.0f / (light.radius * light.radius);
      Float square = in.distance * in.distance;
      strength = strength * one_minus_cos_cone(square, light.radius) * square * (2.0f * inverse);
    }
    if (!any(facing)) return;
    if (casts && bulb) {
      strength = strength * bulb_visibility(at, light, in, facing);
    } else if (casts && p.transparent) {
      strength = strength * transmittance(f, p, interaction.spawn_point, in.wi, in.distance,
                                          at.hit.geom, facing, light.non_occluders, nullptr);
    } else if (casts &&
               (planes_may_occlude(f, light.non_occluders) ||
                any_ray_near_sphere(f.finite_bounds, interaction.spawn_point, in.wi, facing))) {
      facing = facing & ~occluded(f, interaction.spawn_point, in.wi, in.distance, at.hit.geom,
                                  shadow_cone(light, at.bounds.of(interaction, at.lit)), facing,
                                  light.non_occluders);
    }
    facing = facing & (strength > 0.0f);
    if (!any(facing)) return;
    // a lamp without `specular` has no highlight on classic surfaces
    Mask shining = at.s.geometry.physical;
    for (int c = 0; c < CHANNELS; c++) {
      if (light.specular[c] > 0) shining = mask_from_bits(ALL_LANES);
    }
    Float specular, cosine;
    at.lobes(in.wi, facing & shining, specular, cosine);
    for (int c = 0; c < CHANNELS; c++) {
      Float reflected = at.s.specular[c] * specular * highlight(light, at.s.geometry.physical, c) +
                        at.s.diffuse[c] * cosine * light.diffuse[c];
      at.out[c] = select(facing, at.out[c] + reflected * strength, at.out[c]);
    }
  }

  // A glowing geom: its light in closed form where there is one, and for gloss, for shadows and for
  // other shapes small discs on its surface.
  template <int CHANNELS>
  void add_emitter(const Surfaces<CHANNELS>& at, int index) const {
    const Frame& f = at.f;
    const Emitter& e = p.emitters[index];
    Mask others = at.lit & ~(at.hit.geom == splat(e.geom));
    if (!any(others)) return;
    const Geom& g = f.geoms[e.geom];
    const bool closed = has_closed_form(e, g), ball = closed && g.shape == SPHERE;
    Vec start = at.interaction.spawn_point;
    Float whole = splat(0.0f);
    if (closed) {
      Vec normal = at.interaction.normal, flat = at.interaction.geometric_normal;
      whole = emitter_irradiance(g, start, normal);
      others = others & (whole > 0.0f);
      // what is behind a triangle does not light its smooth shading either
      Mask bent = others & (dot(normal, flat) < 0.99999f);
      if (any(bent)) others = others & ~(bent & ~(emitter_irradiance(g, start, flat) > 0.0f));
      if (!any(others)) return;
    }
    const LampPoint* points = cache.lamp_points + index * LAMP_POINTS;
    const int count = points_of(e);
    const float share = static_cast<float>(LAMP_POINTS) / static_cast<float>(count);
    const BoundingSphereArray& b = f.bounds;
    V3 center = {b.x[e.geom], b.y[e.geom], b.z[e.geom]};
    if (g.shape == PLANE) center = g.position;
    float radius = g.shape == PLANE ? g.size[0] + g.size[1] : b.radius[e.geom];
    auto hides = [&](int other, const RayCone& cone, Mask lanes) {
      const Geom& box = f.geoms[other];
      if (box.shape != BOX) return true;
      return any(lanes & ~beyond(at, box, center, radius)) && !aside(box, cone, center, radius);
    };
    bool hidden = visit_hiding(at, center, radius, e.geom, others, hides);
    // the surface's share of each colour
    alignas(64) float shares[3][LANES] = {};
    for (unsigned lanes = to_bits(others); lanes; lanes &= lanes - 1) {
      int i = first_lane(lanes);
      const float* tint = cache.tint + 4 * f.geoms[lane(at.hit.geom, i)].surface;
      for (int c = 0; c < 3; c++) shares[c][i] = tint[c];
    }
    auto add = [&](const LampPoint& point, Mask lanes, const Float* value, Float strength) {
      Received light;
      for (int c = 0; c < 3; c++) light.colour[c] = splat(point.radiance[c]);
      light.luminance = load(shares[0]) * point.radiance[0] + load(shares[1]) * point.radiance[1] +
                        load(shares[2]) * point.radiance[2];
      for (int c = 0; c < CHANNELS; c++) {
        Float reached = value[c] * strength * of_channel<CHANNELS>(f, light, c);
        at.out[c] = select(lanes, at.out[c] + reached, at.out[c]);
      }
    };
    // of a shape with an axis: its own axes, turned towards the surface
    Vec apart = splat(g.position) - start;
    TurnedAxes turned = {};
    if (e.axis >= 0) turned = turned_axes(g, e.axis, apart);
    Float distance_to_ball = sqrt(max(dot(apart, apart), splat(1e-20f)));
    Vec to_ball = apart * (1.0f / distance_to_ball);
    Float ball_strength =
        one_minus_cos_cone(dot(apart, apart), g.size[0]) * (share * 2.0f / LAMP_POINTS);
    // the ray to a point, and the lanes that face each other
    Vec wi;
    Float distance, strength;
    auto reach_ball = [&](Float u, Float v) {
      wi = sample_cone(to_ball, distance_to_ball, g.size[0], {u, v}, p.world, distance);
      distance = max(distance, splat(0.0f));
      strength = ball_strength;
      return others & at.facing(wi);
    };
    auto reach = [&](int k) {
      if (ball) return reach_ball(splat(cache.lamp_x[k]), splat(cache.lamp_y[k]));
      const LampPoint& point = points[k];
      Vec w = splat(point.position), normal = splat(point.normal);
      if (e.axis < 0) {
        w = w - start;
      } else {
        w = turned.to_camera(w) + apart;
        normal = turned.to_camera(normal);
      }
      Float square = max(dot(w, w), splat(1e-20f));
      distance = sqrt(square);
      wi = w * (1.0f / distance);
      Float cosine = -dot(wi, normal);
      // a disc of that area, whose light is finite near it
      float area = point.area * share;
      strength = cosine * area / (square * PI + area);
      return others & at.facing(wi) & (cosine > GRAZING);
    };
    auto reach_outermost = [&](int k) {
      constexpr float RIM = 0.97f;
      if (!ball) return reach(k);
      return reach_ball(splat(RIM), splat((static_cast<float>(k) + 0.5f) / OUTERMOST));
    };
    auto passed = [&](Mask lanes) {
      return transmittance(f, p, start, wi, distance * 0.9999f, at.hit.geom, lanes, 0, nullptr);
    };
    // are the outermost points all lit, or all in shadow?
    Float lowest = splat(1.0f), highest = splat(0.0f);
    Mask tested = mask_from_bits(0);
    for (int k = 0; k < OUTERMOST && hidden; k++) {
      Mask facing = reach_outermost(k);
      if (!any(facing)) continue;
      tested = tested | facing;
      Float share = passed(facing);
      lowest = select(facing, min(lowest, share), lowest);
      highest = select(facing, max(highest, share), highest);
    }
    Mask dark = mask_from_bits(0), partly = dark;
    if (hidden) {
      dark = tested & ~(highest > 0.0f);
      partly = others & ~dark & (~tested | (lowest < 1.0f));
    }
    others = others & ~dark;
    // of a closed form, points give gloss and the share that is seen
    Mask by_points = others;
    if (closed) by_points = (at.glossy() & others) | partly;
    Float all = splat(0.0f), seen = all, value[CHANNELS];
    for (int k = 0; k < count && any(by_points); k++) {
      Mask facing = reach(k) & by_points;
      if (!any(facing)) continue;
      Float light = strength;
      if (any(facing & partly)) {
        light = select(partly, strength * passed(facing & partly), strength);
      }
      if (closed) {
        Float cosine = max(dot(wi, at.s.geometry.normal), splat(0.0f));
        all = select(facing, all + strength * cosine, all);
        seen = select(facing, seen + light * cosine, seen);
      }
      facing = facing & (light > 0.0f);
      if (!any(facing)) continue;
      if (closed && !any(facing & at.glossy())) continue;
      Float specular, cosine;
      at.lobes(wi, facing, specular, cosine);
      for (int c = 0; c < CHANNELS; c++) {
        value[c] = at.s.specular[c] * specular;
        if (!closed) value[c] = value[c] + at.s.diffuse[c] * cosine;
      }
      add(points[k], facing, value, light);
    }
    if (!closed) return;
    // where no point is above the horizon the little light that there is counts as seen
    whole = select(partly & (all > 0.0f), whole * (seen / max(all, splat(1e-30f))), whole);
    for (int c = 0; c < CHANNELS; c++) value[c] = at.s.diffuse[c];
    add(points[0], others, value, whole);
  }

  // How many points a glowing geom has: several geoms share them by power, each a power of two.
  EVS_INLINE static int points_of(const Emitter& e) {
    int count = LAMP_POINTS;
    float share = (e.end - e.begin) * static_cast<float>(LAMP_POINTS);
    while (count > FEWEST_POINTS && static_cast<float>(count / 2) >= share) count /= 2;
    return count;
  }
};

// `trace`, with the light of the cache.
inline void trace_hybrid(const Frame& f, const PathFrame& p, const IrradianceView& cache,
                         NodeRequests& requests, int column, int row, const Outputs& out,
                         KeptPacket* kept) {
  KeptWriter keeps = {};
  if (kept) keeps = {kept->rows, kept->surfaces, kept->nodes};
  HybridShading shading = {p, cache, requests, kept ? &keeps : nullptr};
  for_channels(f, [&]<int CHANNELS>() {
    trace_packet<CHANNELS>(shading, f, column, row, out, kept ? &kept->record : nullptr);
  });
  if (kept) kept->complete = keeps.complete && requests.complete;
}

// The same from what a packet has kept. In: its surfaces, or null where their lamps are as they
// were.
inline void relight_hybrid(const Frame& f, const PathFrame& p, const IrradianceView& cache,
                           NodeRequests& requests, int column, int row, const Outputs& out,
                           const KeptNodes& nodes, float* rows, const float* surfaces) {
  HybridShading shading = {p, cache, requests};
  for_channels(f, [&]<int CHANNELS>() {
    auto lamps = [&](int sample, float step, Mask lit, Float* light) {
      Rays rays = primary_rays(f, column, row, f.sample_x[sample], f.sample_y[sample]);
      KeptSurface<CHANNELS> kept;
      read_surface(surfaces + sample * surface_rows(CHANNELS) * PACKET, step, rays.direction, kept);
      shading.relight<CHANNELS>(f, rays, kept, lit, light);
    };
    relight_kept<CHANNELS>(f, cache, column, row, out, nodes, rows, surfaces ? &lamps : nullptr);
  });
}

// `refine`, with the light of the cache. In/out: what the packet keeps, without rows, or null.
inline void refine_hybrid(const Frame& f, const PathFrame& p, const IrradianceView& cache,
                          NodeRequests& requests, int column, int row, unsigned pixels,
                          float* luminance, float* rgb, KeptPacket* kept) {
  KeptWriter keeps = {};
  if (kept) keeps.nodes = kept->nodes;
  HybridShading shading = {p, cache, requests, kept ? &keeps : nullptr};
  for_channels(f, [&]<int CHANNELS>() {
    refine_packet<CHANNELS>(shading, f, column, row, pixels, luminance, rgb,
                            kept ? &kept->record : nullptr);
  });
  if (kept) kept->complete = keeps.complete;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
