// What a light gives a point: direction, distance, strength; and the hull of the rays towards it.
#pragma once

#include "geometry/ray_cone.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

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
  if (light.inverse_square || a[1] != 0 || a[2] != 0) {
    Float fall = light.inverse_square ? square : square * a[2] + in.distance * a[1] + a[0];
    in.strength = 1.0f / max(fall, splat(1e-12f));
  } else {
    in.strength = splat(1.0f / (a[0] > 1e-12f ? a[0] : 1e-12f));
  }
  // physical light ends smoothly at its range, as in MuJoCo's physical renderer
  if (light.fade > 0) {
    Float share = square * light.fade;
    Float left = max(1.0f - share * share, splat(0.0f));
    in.strength = in.strength * (left * left);
  }
  if (light.kind == SPOT) {
    Float cosine = -(in.towards.x * light.direction.x + in.towards.y * light.direction.y +
                     in.towards.z * light.direction.z);
    Mask inside = cosine >= light.cos_cutoff;
    Float cone = splat(1.0f);
    if (light.edge > 0) {
      Float share = min((cosine - light.cos_cutoff) * light.edge, splat(1.0f));
      cone = share * share;
    } else if (light.exponent > 0 && any(inside)) {
      cone = power(min(max(cosine, splat(0.0f)), splat(1.0f)), light.exponent);
    }
    in.strength = select(inside, in.strength * cone, splat(0.0f));
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

// Light of an image light that a surface with this normal (camera frame) receives from everywhere,
// over pi: what white paper gives back. Never negative, where the smooth fit of a hard sky is.
template <int CHANNELS>
void received_from_image(const Frame& f, const Light& light, Vec normal, Float* out) {
  Vec n = to_camera(f.sky_rotation, normal);  // here: from the camera's frame to the world's
  Float terms[8] = {n.y,       n.z,
                    n.x,       n.x * n.y,
                    n.y * n.z, n.z * n.z * 3.0f - 1.0f,
                    n.x * n.z, n.x * n.x - n.y * n.y};
  for (int c = 0; c < CHANNELS; c++) {
    Float sum = splat(light.harmonics[c][0]);
    for (int i = 0; i < 8; i++) sum = sum + terms[i] * light.harmonics[c][i + 1];
    out[c] = max(sum, splat(0.0f)) * light.diffuse[c];
  }
}

}  // namespace
}  // namespace evs::EVS_SPACE
