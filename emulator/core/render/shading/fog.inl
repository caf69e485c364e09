// Fog, and the haze below the horizon, between the camera and what it sees.
#pragma once

#include "render/geometry/rays.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Blend light with the fog's colour. The fog's transmittance falls linearly from its start to its
// end, as in OpenGL.
template <int CHANNELS>
void apply_fog(const Frame& f, Float distance, Float* light) {
  Float transmittance = (f.medium.fog_end - distance) * f.medium.fog_slope;
  transmittance = min(max(transmittance, splat(0.0f)), splat(1.0f));
  for (int c = 0; c < CHANNELS; c++)
    light[c] = f.medium.fog_color[c] + (light[c] - f.medium.fog_color[c]) * transmittance;
}

// Haze along camera rays. MuJoCo's viewer draws it on a cone around the camera, from the plane up
// to the horizon; everything behind the cone is behind the haze. Its opacity rises up to where the
// plane ends, where it is 1, and falls again towards the sky. Out: opacity, 0 ... 1; distance to
// the cone.
EVS_INLINE Float haze(const Frame& f, Vec direction, Float& distance) {
  const Medium& medium = f.medium;
  Float rise = dot(direction, splat(medium.haze_up));
  Float along = sqrt(max(1.0f - rise * rise, splat(1e-12f)));
  Float drop = max(-rise, splat(0.0f)) / along;
  // height on the cone: 0 on the plane, 1 at the horizon; `below` is the rest
  Float below = drop / (drop * medium.haze_ratio + medium.haze_elevation);
  Float height = 1.0f - below;
  distance = (1.0f - below * medium.haze_ratio) * medium.haze_radius / along;
  Float haze_alpha =
      min(height * (1.0f / medium.haze_peak), below * (1.0f / (1.0f - medium.haze_peak)));
  return max(haze_alpha, splat(0.0f));
}

// Find the lanes whose camera ray meets an infinite plane behind the haze. MuJoCo's viewer ends
// such a plane there and draws the sky from its edge up.
EVS_INLINE Mask behind_haze(const Frame& f, Vec direction, const Hit& hit) {
  Float rise = dot(direction, splat(f.medium.haze_up));
  Float along = sqrt(max(1.0f - rise * rise, splat(1e-12f)));
  Mask ended = mask_from_bits(0);
  for (int k = 0; k < f.plane_count; k++) {
    const Geom& g = f.geoms[k];
    if (g.size[0] <= 0 || g.size[1] <= 0) ended = ended | (hit.geom == splat(k));
  }
  return ended & (hit.distance * along > f.medium.haze_radius);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
