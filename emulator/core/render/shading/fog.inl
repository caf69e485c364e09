// What lies between the camera and what it sees: fog, and the haze below a horizon.
#pragma once

#include "geometry/rays.inl"
#include "scene.h"

namespace evs::EVS_SPACE {
namespace {

// Fog takes the place of light from afar: linear from its start to its end, as OpenGL's, by the
// distance that light travelled.
template <int CHANNELS>
void fog(const Frame& f, Float distance, Float* light) {
  Float clear = (f.air.fog_end - distance) * f.air.fog_slope;
  clear = min(max(clear, splat(0.0f)), splat(1.0f));
  for (int c = 0; c < CHANNELS; c++)
    light[c] = f.air.fog_color[c] + (light[c] - f.air.fog_color[c]) * clear;
}

// Haze along primary rays. MuJoCo's viewer draws it on a cone around the camera, from the plane up
// to the horizon; what lies behind the cone is behind the haze. Its colour fades in up to where the
// plane ends, which it covers whole, and out again before the sky. Out: how much it covers, 0 ...
// 1; distance to the cone.
EVS_INLINE Float haze(const Frame& f, Vec direction, Float& distance) {
  const Air& air = f.air;
  Float rise = dot(direction, splat(air.haze_up));
  Float along = sqrt(max(1.0f - rise * rise, splat(1e-12f)));
  Float drop = max(-rise, splat(0.0f)) / along;
  // height on the cone, 1 at the horizon and 0 on the plane; `below` is the rest of it
  Float below = drop / (drop * air.haze_ratio + air.haze_elevation);
  Float height = 1.0f - below;
  distance = (1.0f - below * air.haze_ratio) * air.haze_radius / along;
  Float cover = min(height * (1.0f / air.haze_peak), below * (1.0f / (1.0f - air.haze_peak)));
  return max(cover, splat(0.0f));
}

// Lanes whose primary ray meets a plane without bounds beyond the haze. MuJoCo's viewer stands the
// sky there, a wall around the camera: such a plane ends at its foot.
EVS_INLINE Mask beyond_haze(const Frame& f, Vec direction, const Hit& hit) {
  Float rise = dot(direction, splat(f.air.haze_up));
  Float along = sqrt(max(1.0f - rise * rise, splat(1e-12f)));
  Mask ended = mask_of(0);
  for (int k = 0; k < f.plane_count; k++) {
    const Geom& g = f.geoms[k];
    if (g.size[0] <= 0 || g.size[1] <= 0) ended = ended | (hit.geom == splat(k));
  }
  return ended & (hit.distance * along > f.air.haze_radius);
}

}  // namespace
}  // namespace evs::EVS_SPACE
