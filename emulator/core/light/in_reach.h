// What rays need not look for: no shadow and, in `direct`, no image in a mirror where nothing is
// near.

// Can a ray of `active` come near the ball? With the slack of `any_near`.
EVS_INLINE bool any_towards(const Ball& ball, Vec origin, Vec direction, Mask active) {
  if (ball.radius < 0) return false;
  Vec v = splat(ball.center) - origin;
  Float along = dot(v, direction);
  Vec across = v - direction * along;
  Float reach = abs(along) * 2e-6f + ball.radius * 1.000002f;
  return any(active & (along >= -reach) & (dot(across, across) <= reach * reach));
}

// Can a plane be in the way of a light that `idle` of them never bar?
EVS_INLINE bool barred_by_planes(const Frame& f, uint32_t idle) {
  uint32_t planes = f.plane_count < 32 ? (1u << f.plane_count) - 1 : ~0u;
  return f.plane_count > 32 || (planes & ~idle);
}

// The points of a patch, once somebody asks where they are.
struct Points {
  Region region;
  bool known = false;

  template <int CHANNELS>
  const Region& of(const Patch<CHANNELS>& patch, Mask lit) {
    if (!known) region = region_of(patch.origin, patch.step, lit);
    known = true;
    return region;
  }
};

// Do camera rays that hit the only plane, which is flat, see nothing in it? What they see there is
// what they would run into behind it. A ray that grazes it is left to the trace.
EVS_INLINE bool mirrors_nothing(const Frame& f, const Rays& rays, const Hit& hit, Mask mirror) {
  if (!rays.common || f.bumpy || f.mirrored.radius >= FAR) return false;
  if (any(mirror & ~(hit.geom == splat(0)))) return false;
  const float* r = f.geoms[0].rotation;
  if (any(mirror & (dot(rays.direction, splat(V3{r[2], r[5], r[8]})) > -1e-4f))) return false;
  return !any_towards(f.mirrored, rays.origin, rays.direction, mirror);
}
