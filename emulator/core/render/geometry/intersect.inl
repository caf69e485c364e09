// Intersect rays with the whole scene: the nearest hit, and occlusion.
#pragma once

#include "render/geometry/bvh_traversal.inl"
#include "render/geometry/candidates.inl"
#include "render/geometry/outlines.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

EVS_INLINE Vec local_origin(const Geom& g, const Rays& rays) {
  if (rays.common) return splat(g.camera);
  return to_local(g.rotation, rays.origin - splat(g.position));
}

// The lanes that come near the bounding sphere of geom `index`: by `reach` in a camera's image at
// depth 1. The slack is that of `cone_touches`.
EVS_INLINE Mask rays_near(const Frame& f, int index, const Rays& rays, float reach, Mask active) {
  if (f.geoms[index].shape == PLANE) return active;
  const BoundingSphereArray& b = f.bounds;
  Vec v = splat(V3{b.x[index], b.y[index], b.z[index]}) - rays.origin;
  Float along = dot(v, rays.direction);
  Vec across = v - rays.direction * along;
  Float wide = abs(rays.direction.z) * reach + 2e-6f;
  Float slack = abs(along) * wide + b.radius[index] * 1.000002f;
  return active & (along >= -slack) & (dot(across, across) <= slack * slack);
}

// What rays have passed through: the last hits, whose distance is `t_min`, and their geoms' ranks.
struct Passed {
  Float t_min;
  Int rank;  // below 0: none
};

// Rays that begin at `t_min`, and have passed through nothing.
EVS_INLINE Passed from(Float t_min) { return {t_min, splat(-1)}; }

EVS_INLINE Int rank_of(const Frame& f, Int geom) {
  constexpr int STRIDE = sizeof(Geom) / sizeof(int);
  const float* first = reinterpret_cast<const float*>(&f.geoms->rank);
  return as_int(gather(first, select(geom < splat(0), splat(0), geom) * splat(STRIDE)));
}

// Rays that have passed through the hits of `lit`.
EVS_INLINE Passed through(const Frame& f, const Hit& hit, Mask lit) {
  return {hit.distance, any(lit) ? select(lit, rank_of(f, hit.geom), splat(-1)) : splat(-1)};
}

// Where hits of geom `g` count. Of surfaces that coincide with the last hit, those that come before
// it in the scene lie behind it.
EVS_INLINE Float begin_of(const Geom& g, const Passed& passed, bool layered) {
  if (!layered) return passed.t_min;
  Mask behind = splat(g.rank) < passed.rank;
  return select(passed.rank < splat(0), passed.t_min,
                passed.t_min * select(behind, splat(1.0f - COINCIDENT), splat(1.0f + COINCIDENT)));
}

// The lanes of `near`, whose distance is less than that of `hit` or coincides with it, that see
// geom `g`: MuJoCo's depth test lets the last of the geoms win.
EVS_INLINE Mask wins(const Frame& f, const Geom& g, Float t, const Hit& hit, Mask near) {
  Mask tie = near & ~(t < hit.distance * (1.0f - COINCIDENT));
  if (!any(tie)) return near;
  return near & ~(tie & ~(rank_of(f, hit.geom) < splat(g.rank)));
}

// The first hits of camera rays, and how much of their cells is covered by what they hit.
struct CoveredHit : Hit {
  static constexpr bool COVERS = true;
  Coverage coverage;
  CellRays cells;  // of the rays
};

// Let rays that pass a shape by hit it where it covers a part of their cells. In: rays in the
// geom's frame.
EVS_INLINE Coverage cover(const Frame& f, int index, const Rays& rays, const CellRays& cells, Vec o,
                          Vec d, Float& t) {
  const Geom& g = f.geoms[index];
  if (f.cells > 1) d = to_local(g.rotation, cells.direction);
  Outline outline = {g.rotation, cells, f.outline_reach, d, {}};
  outline.shape(g, o);
  const Coverage& c = outline.covered;
  Mask beside = ~(t < T_INFINITY) & (c.share > 0.0f) & (c.share < 1.0f) & (c.distance > 0.0f);
  if (any(beside)) beside = rays_near(f, index, rays, f.outline_reach, beside);
  t = select(beside, c.distance, select(c.share > 0.0f, t, splat(T_INFINITY)));
  return c;
}

// Keep the hits of geom `index` that are nearer. near_rays: of a mesh, the triangles near the rays;
// null: all.
template <class AnyHit>
EVS_INLINE void intersect_geom(const Frame& f, int index, const Rays& rays, const Passed& passed,
                               bool layered, AnyHit& hit, const TriangleList* near_rays = nullptr) {
  // transform the rays to the geom's frame
  const Geom& g = f.geoms[index];
  Vec o = local_origin(g, rays), d = to_local(g.rotation, rays.direction);
  Float t_min = begin_of(g, passed, layered), t;
  Float t_max = hit.distance * (1.0f + COINCIDENT);
  Mask near;
  Coverage coverage;
  if (g.shape == MESH || g.shape == HFIELD) {
    Hit found = hit;
    found.distance = t_max;
    const Mesh& mesh = f.meshes[g.mesh];
    MeshRays r = mesh_rays(mesh, o, d);
    near = near_rays
               ? intersect_listed(mesh, *near_rays, r, t_min, found.distance, found.triangle,
                                  found.u, found.v)
               : intersect_mesh(mesh, r, t_min, found.distance, found.triangle, found.u, found.v);
    if (!any(near)) return;
    t = found.distance;
    near = wins(f, g, t, hit, near);
    hit.triangle = select(near, found.triangle, hit.triangle);
    hit.u = select(near, found.u, hit.u);
    hit.v = select(near, found.v, hit.v);
  } else {
    t = intersect_shape(g, o, d);
    if constexpr (AnyHit::COVERS) {
      if (f.outline_reach > 0) coverage = cover(f, index, rays, hit.cells, o, d, t);
    }
    near = (t < min(t_max, splat(T_INFINITY))) & (t > t_min);
    if (!any(near)) return;
    near = wins(f, g, t, hit, near);
  }
  // the nearer of two that coincide is outside of both
  hit.distance = select(near, min(t, hit.distance), hit.distance);
  hit.geom = select(near, splat(index), hit.geom);
  if constexpr (AnyHit::COVERS) hit.coverage = choose(near, coverage, hit.coverage);
}

// The rest of `intersect` in a scene of many geoms.
template <class AnyHit>
[[gnu::noinline]] EVS_OUTLINE void intersect_many(const Frame& f, const Rays& rays,
                                                  const RayCone& cone, Mask active,
                                                  const Passed& passed, bool layered, AnyHit& hit) {
  GeomSet found;
  float reach = AnyHit::COVERS ? OUTLINE_ROOM * f.outline_reach : 0.0f;
  find_candidates(f.bvh, rays, cone, active, splat(T_INFINITY), reach, found);
  found.visit([&](int index) {
    intersect_geom(f, index, rays, passed, layered, hit);
    return false;
  });
}

// Find the nearest hit of the rays of `active` behind what they have passed; of hits that coincide,
// that of the last geom of the scene. Geoms are intersected in ascending order, whatever culls
// them. `layered`: some rays have passed through something. In/out: the hits, of nothing.
template <class AnyHit>
EVS_OUTLINE_IN_PATHS inline void find_hits(const Frame& f, const Rays& rays, const RayCone& cone,
                                           Mask active, const Passed& passed, bool layered,
                                           AnyHit& hit) {
  bool wide = is_wide(cone);
  float reach = AnyHit::COVERS ? f.outline_reach : 0.0f;
  for (int k = 0, end = candidates_end(f, cone); k < end; k += LANES) {
    for (unsigned near = candidates(f, k, end, cone); near; near &= near - 1) {
      int index = k + first_lane(near);
      if (wide && !any(rays_near(f, index, rays, reach, active))) continue;
      intersect_geom(f, index, rays, passed, layered, hit);
    }
  }
  if (f.bvh.top > 0 && cone_may_touch(f.finite_bounds, cone)) {
    intersect_many(f, rays, cone, active, passed, layered, hit);
  }
}

EVS_INLINE Hit no_hit(Mask active) {
  return {select(active, splat(T_INFINITY), splat(-1.0f)), splat(-1), splat(0), splat(0.0f),
          splat(0.0f)};
}

// Find the nearest hits as above.
EVS_INLINE Hit intersect(const Frame& f, const Rays& rays, const RayCone& cone, Mask active,
                         const Passed& passed, bool layered = false) {
  Hit hit = no_hit(active);
  find_hits(f, rays, cone, active, passed, layered, hit);
  return hit;
}

// Add the lanes of `tested` whose ray geom `index` occludes before `t_max`.
EVS_INLINE void occlude(const Frame& f, int index, const Rays& rays, Float t_max, Mask tested,
                        Mask& blocked) {
  const Geom& g = f.geoms[index];
  Vec o = local_origin(g, rays), d = to_local(g.rotation, rays.direction);
  if (g.shape == MESH || g.shape == HFIELD) {
    blocked = blocked | occluded_mesh(f.meshes[g.mesh], mesh_rays(f.meshes[g.mesh], o, d),
                                      rays.origin, t_max, tested);
  } else {
    blocked = blocked | (tested & (intersect_shape(g, o, d) < t_max));
  }
}

// The lanes that a geom can occlude: a convex shape cannot shade itself.
EVS_INLINE Mask lanes_to_test(const Frame& f, int index, Int self, Mask left) {
  int shape = f.geoms[index].shape;
  return shape == MESH || shape == HFIELD ? left : left & ~(self == splat(index));
}

// Can rays pass through a geom?
EVS_INLINE bool is_transparent(const Frame& f, int index) {
  return f.surfaces[f.geoms[index].surface].transparent();
}

// Turn the rays of `partly` to the middle of what their shape covers of their cells, and find their
// hits there. Returns the lanes where that is not found.
inline Mask turn_to_covered(const Frame& f, Rays& rays, CoveredHit& hit, Mask partly) {
  const Coverage& c = hit.coverage;
  Vec turn = {hit.cells.x * c.x, hit.cells.y * c.y, splat(0.0f)};
  Vec turned = normalize(hit.cells.direction + turn);
  Mask lost = mask_from_bits(0);
  for (unsigned left = to_bits(partly); left;) {
    int index = lane(hit.geom, first_lane(left));
    Mask here = partly & (hit.geom == splat(index));
    left &= ~to_bits(here);
    const Geom& g = f.geoms[index];
    Float t = intersect_shape(g, local_origin(g, rays), to_local(g.rotation, turned));
    lost = lost | (here & ~(t < T_INFINITY));
    here = here & (t < T_INFINITY);
    hit.distance = select(here, t, hit.distance);
    rays.direction = select(here, turned, rays.direction);
  }
  return lost;
}

// The rest of `occluded` in a scene of many geoms.
template <bool BY_OPAQUE>
[[gnu::noinline]] EVS_OUTLINE void occluded_by_many(const Frame& f, const Rays& rays,
                                                    const RayCone& cone, Mask active, Float t_max,
                                                    Int self, Mask& blocked) {
  GeomSet found;
  find_candidates(f.bvh, rays, cone, active & ~blocked, t_max, 0, found);
  found.visit([&](int index) {
    if (BY_OPAQUE && is_transparent(f, index)) return false;
    Mask tested = lanes_to_test(f, index, self, active & ~blocked);
    if (any(tested)) occlude(f, index, rays, t_max, tested, blocked);
    return !any(active & ~blocked);
  });
}

// Find the lanes whose ray is occluded before `t_max`. `self`: the geom that the ray starts on.
// `non_occluders`: geoms of the first 32 that are known not to occlude, one bit each. BY_OPAQUE: by
// opaque geoms alone.
template <bool BY_OPAQUE = false>
EVS_OUTLINE_IN_PATHS Mask occluded(const Frame& f, Vec origin, Vec direction, Float t_max, Int self,
                                   const RayCone& cone, Mask active, unsigned non_occluders) {
  Mask blocked = mask_from_bits(0);
  Rays rays = {origin, direction, false};
  bool wide = is_wide(cone);
  for (int k = 0, end = candidates_end(f, cone); k < end; k += LANES) {
    unsigned near = candidates(f, k, end, cone);
    if (k < 32) near &= ~(non_occluders >> k);
    for (; near; near &= near - 1) {
      int index = k + first_lane(near);
      if (BY_OPAQUE && is_transparent(f, index)) continue;
      // skip the geom if no lane can hit it
      Mask tested = lanes_to_test(f, index, self, active & ~blocked);
      if (!any(tested) || (wide && !any(rays_near(f, index, rays, 0, tested)))) continue;
      // intersect the others, until every lane is blocked
      occlude(f, index, rays, t_max, tested, blocked);
      if (!any(active & ~blocked)) return blocked;
    }
  }
  if (f.bvh.top > 0 && cone_may_touch(f.finite_bounds, cone)) {
    occluded_by_many<BY_OPAQUE>(f, rays, cone, active, t_max, self, blocked);
  }
  return blocked;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
