// What a light gives a point: direction, distance, strength; and the hull of the rays towards it.

struct Incidence {
  Vec towards;     // unit
  Float distance;  // m
  Float strength;  // attenuation and cone, 0 ... ; shadows not counted
};

EVS_INLINE Incidence incidence(const Light& light, Vec point) {
  Incidence in;
  if (light.kind == DIRECTIONAL) {
    in.towards = splat(scaled(light.direction, -1.0f));
    in.distance = splat(FAR);
    in.strength = splat(1.0f);
    return in;
  }
  Vec w = splat(light.position) - point;
  Float square = max(dot(w, w), splat(1e-12f));
  in.distance = sqrt(square);
  in.towards = w * (1.0f / in.distance);
  const float* a = light.attenuation;
  Float fall = light.inverse_square ? square : square * a[2] + in.distance * a[1] + a[0];
  in.strength = 1.0f / max(fall, splat(1e-12f));
  if (light.kind == SPOT) {
    Float cosine = -(in.towards.x * light.direction.x + in.towards.y * light.direction.y +
                     in.towards.z * light.direction.z);
    Float cone = light.exponent > 0
                     ? power(min(max(cosine, splat(0.0f)), splat(1.0f)), light.exponent)
                     : splat(1.0f);
    in.strength = select(cosine >= light.cos_cutoff, in.strength * cone, splat(0.0f));
  }
  return in;
}

// A box of points that grows; as a ball it is where shadow and mirror rays start.
struct Region {
  V3 low = {FAR, FAR, FAR}, high = {-FAR, -FAR, -FAR};
  float step = 0;  // how far the points were moved off their surfaces, at most
};

EVS_INLINE void grow(Region& r, Vec p, float step, Mask active) {
  r.step = step > r.step ? step : r.step;
  auto widen = [&](float& low, float& high, Float x) {
    float a = lowest(select(active, x, splat(FAR))), b = highest(select(active, x, splat(-FAR)));
    low = a < low ? a : low;
    high = b > high ? b : high;
  };
  widen(r.low.x, r.high.x, p.x);
  widen(r.low.y, r.high.y, p.y);
  widen(r.low.z, r.high.z, p.z);
}

EVS_INLINE Hull ball_of(const Region& r) {
  Hull hull;
  hull.center = {0.5f * (r.low.x + r.high.x), 0.5f * (r.low.y + r.high.y),
                 0.5f * (r.low.z + r.high.z)};
  hull.radius = radius_of(hull.center, r.high);
  hull.axis = {0, 0, -1};
  hull.length = 0;
  hull.cosine = 1;
  hull.sine = 0;
  return hull;
}

// Every segment from the region to the light lies within the ball's radius of the axis; rays that
// start a step off their surface run parallel to that, and miss the light by the step.
EVS_INLINE Hull shadow_hull(const Light& light, const Region& region) {
  Hull hull = ball_of(region);
  hull.radius += region.step;
  if (light.kind == DIRECTIONAL) {
    hull.axis = scaled(light.direction, -1.0f);
    hull.length = FAR;
  } else {
    V3 w = light.position - hull.center;
    hull.axis = normalized(w);
    hull.length = __builtin_sqrtf(dot(w, w));
  }
  return hull;
}
