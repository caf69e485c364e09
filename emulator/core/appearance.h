// How things look, ready for the kernels: lights, surfaces, and textures with the surface's colour
// in them.
#pragma once

#include <vector>

#include "mipmap.h"
#include "scene.h"
#include "scene_data.h"

namespace evs {

struct Appearance {
  int channels;      // 1: every light is grey, so that luminance alone is carried; 3: RGB
  float weights[3];  // luminance of each channel
  std::vector<Light> lights;
  std::vector<bool> headlight;  // of each light
  std::vector<Surface> surfaces;
  std::vector<Chain> chains;
  std::vector<Texture> textures;  // views of the chains
  int skybox;                     // index into textures, -1 none
};

Appearance make_appearance(const SceneData& scene);

}  // namespace evs
