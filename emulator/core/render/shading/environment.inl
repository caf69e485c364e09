// Radiance of the environment along camera rays; with a perspective camera the mean of several
// points in each pixel.
#pragma once

#include "render/shading/texture.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

template <int CHANNELS>
EVS_OUTLINE void camera_environment(const Frame& f, Vec d, unsigned lanes, Float* out) {
  const Texture& t = f.textures[f.skybox];
  const float* r = f.camera_to_world;
  Vec w = to_camera(r, d);
  float footprint = f.orthographic ? 0.0f : 0.5f * f.pixel_angle;
  Float scale = -d.z;
  // add up the taps of the pixel
  int taps = f.taps > 1 ? f.taps : 1;
  Lod lod;
  for (int i = 0; i < taps; i++) {
    Vec to = w;
    if (taps > 1) {
      Float x = scale * (f.tap_x[i] / f.fx), y = scale * (f.tap_y[i] / -f.fy);
      to = {w.x + x * r[0] + y * r[1], w.y + x * r[3] + y * r[4], w.z + x * r[6] + y * r[7]};
    }
    Float u, v, major;
    Int face;
    cube_coordinates({to.x, to.z, -to.y}, u, v, face, major);
    // the points lie close together, so all use the first one's level of detail
    if (i == 0)
      lod = lod_of(t, splat(taps > 1 ? footprint * f.tap_width : footprint) / major, lanes);
    Float texel[CHANNELS];
    read_lod(t, CHANNELS, lod, u, v, face, i == 0 ? out : texel);
    if (i == 0) continue;
    for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + texel[c];
  }
  if (taps == 1) return;
  for (int c = 0; c < CHANNELS; c++) out[c] = out[c] * (1.0f / static_cast<float>(taps));
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
