// Radiance of the environment along camera rays; with a perspective camera the mean of several
// points in each pixel.
#pragma once

#include "render/shading/bsdf.inl"
#include "render/shading/texture.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

template <int CHANNELS>
EVS_OUTLINE void camera_environment(const Frame& f, const Rays& rays, unsigned lanes, Float* out) {
  const Texture& t = f.textures[f.skybox];
  const float* r = f.camera_to_world;
  const Vec d = rays.direction, w = to_camera(r, d);
  float footprint = f.orthographic ? 0.0f : 0.5f * f.pixel_angle;
  // the pixel's sides: in the image plane, turned by a mirror, or anywhere across the ray
  Vec right = splat(V3{1, 0, 0}), up = splat(V3{0, 1, 0});
  if (rays.primary) {
    right = right * -d.z;
    up = up * -d.z;
  } else if (rays.mirror) {
    const Vec n = *rays.mirror;
    const Float depth = n.z * (dot(d, n) * 2.0f) - d.z;
    right = (right - n * (n.x * 2.0f)) * depth;
    up = (up - n * (n.y * 2.0f)) * depth;
  } else {
    axes_of(d, right, up);
  }
  // The middle of the pixel serves where the sky is so smooth that its mean differs by less than
  // SMOOTH: of a box on lines that meet, by an eighth of its width times their bend.
  constexpr float SMOOTH = 0.004f;
  const int taps = f.taps > 1 ? f.taps : 1;
  Mask smooth = mask_from_bits(0);
  Float middle[CHANNELS];
  if (taps == 1 || t.bend < 1) {
    Float u, v, major;
    Int face;
    cube_coordinates({w.x, w.z, -w.y}, u, v, face, major);
    float texels = footprint * static_cast<float>(t.level[0].width);
    smooth = splat(texels * t.bend) < major * major * (8 * SMOOTH);
    if (taps == 1) smooth = mask_from_bits(ALL_LANES);
    if (any(smooth & mask_from_bits(lanes)))
      read_lod(t, CHANNELS, lod_of(t, splat(footprint) / major, lanes), u, v, face, middle);
    if (!any(~smooth & mask_from_bits(lanes))) {
      for (int c = 0; c < CHANNELS; c++) out[c] = middle[c];
      return;
    }
  }
  // add up the taps
  Lod lod;
  for (int i = 0; i < taps; i++) {
    Vec to = to_camera(r, d + (right * splat(f.tap_x[i] / f.fx) - up * splat(f.tap_y[i] / f.fy)));
    Float u, v, major;
    Int face;
    cube_coordinates({to.x, to.z, -to.y}, u, v, face, major);
    // the points lie close together, so all use the first one's level of detail
    if (i == 0) lod = lod_of(t, splat(footprint * f.tap_width) / major, lanes);
    Float texel[CHANNELS];
    read_lod(t, CHANNELS, lod, u, v, face, i == 0 ? out : texel);
    if (i == 0) continue;
    for (int c = 0; c < CHANNELS; c++) out[c] = out[c] + texel[c];
  }
  for (int c = 0; c < CHANNELS; c++)
    out[c] = select(smooth, middle[c], out[c] * (1.0f / static_cast<float>(taps)));
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
