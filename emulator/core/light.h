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
                     ? power(min(max(cosine, splat(0.0f)), splat(1.0f)), splat(light.exponent))
                     : splat(1.0f);
    in.strength = select(cosine >= light.cos_cutoff, in.strength * cone, splat(0.0f));
  }
  return in;
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
