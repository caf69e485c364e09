// MuJoCo's lights: direction, distance and strength at a point, and the bounding cone of shadow
// rays.
#pragma once

#include "render/geometry/ray_cone.inl"
#include "scene/light.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct Incidence {
  Vec wi;          // unit
  Float distance;  // m
  Float strength;  // attenuation times cone, without shadows
};

EVS_INLINE Incidence incidence(const Light& light, Vec point) {
  Incidence in;
  if (light.is_delta_direction()) {
    in.wi = splat(scaled(light.direction, -1.0f));
    in.distance = splat(T_INFINITY);
    in.strength = splat(1.0f);
    return in;
  }
  // direction and distance
  Vec w = splat(light.position) - point;
  Float square = max(dot(w, w), splat(1e-12f));
  in.distance = sqrt(square);
  in.wi = w * (1.0f / in.distance);
  // attenuate with the distance
  const float* a = light.attenuation;
  if (light.inverse_square || a[1] != 0 || a[2] != 0) {
    Float fall = light.inverse_square ? square : square * a[2] + in.distance * a[1] + a[0];
    in.strength = 1.0f / max(fall, splat(1e-12f));
  } else {
    in.strength = splat(1.0f / (a[0] > 1e-12f ? a[0] : 1e-12f));
  }
  // physical light falls smoothly to 0 at its range, as in MuJoCo's physical renderer
  if (light.fade > 0) {
    Float share = square * light.fade;
    Float left = max(1.0f - share * share, splat(0.0f));
    in.strength = in.strength * (left * left);
  }
  // limit a spot light to its cone
  if (light.has_cone()) {
    Float cosine =
        -(in.wi.x * light.direction.x + in.wi.y * light.direction.y + in.wi.z * light.direction.z);
    Mask inside = cosine >= light.cos_cutoff;
    Float cone = splat(1.0f);
    if (light.edge > 0) {
      Float share = min((cosine - light.cos_cutoff) * light.edge, splat(1.0f));
      cone = share * share;
    } else if (light.exponent > 0 && any(inside)) {
      cone = pow(min(max(cosine, splat(0.0f)), splat(1.0f)), light.exponent);
    }
    in.strength = select(inside, in.strength * cone, splat(0.0f));
  }
  return in;
}

// Bound the shadow rays from a box to the light: every segment lies within the sphere's radius of
// the axis. Rays start a step off their surface, parallel to that segment, and miss the light by
// the step.
EVS_INLINE RayCone shadow_cone(const Light& light, const BoundingBox& box) {
  RayCone cone = bounding_sphere(box);
  cone.radius += box.step;
  if (light.is_delta_direction()) {
    cone.axis = scaled(light.direction, -1.0f);
    cone.length = T_INFINITY;
  } else {
    V3 w = light.position - cone.center;
    cone.axis = normalized(w);
    cone.length = __builtin_sqrtf(dot(w, w));
  }
  return cone;
}

// Irradiance of an image light, over pi, on a surface with this normal (camera frame): what white
// paper reflects. Clamped at 0, because the smooth fit of a harsh sky can be negative.
template <int CHANNELS>
void image_irradiance(const Frame& f, const Light& light, Vec normal, Float* out) {
  Vec n = to_camera(f.camera_to_world, normal);  // camera frame to world frame
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
}  // namespace evs::EVS_NAMESPACE
