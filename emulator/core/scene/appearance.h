// How things look, ready for the kernels: lights, surfaces, and textures with the surface's colour
// in them.
#pragma once

#include <vector>

#include "mipmap.h"
#include "scene.h"
#include "scene_data.h"

namespace evs {

struct Appearance {
  // 1: every light is grey, so that luminance alone is carried; 3: RGB; 4: grey lights again, and
  // after the luminance, which keeps its bytes, RGB. Lights and surfaces have one channel more, the
  // luminance, for a frame that carries it `plain`.
  int channels;
  float weights[MAX_CHANNELS];  // luminance of each channel
  std::vector<Light> lights;
  std::vector<bool> headlight;  // of each light
  std::vector<Surface> surfaces;
  std::vector<Chain> chains;
  std::vector<Texture> textures;  // views of the chains
  int skybox;                     // index into textures, -1 none
  bool layered;                   // a surface is physical or has maps
  bool bumpy;                     // a surface has a normal map
  Air air;                        // but for where the camera is
};

// rgb: colour is wanted, whatever the lights are; the luminance keeps its bytes. mixing: light goes
// from surface to surface, which needs its colour: three channels. grey: lights lose their colour
// instead (for tests).
Appearance make_appearance(const SceneData& scene, bool rgb, bool mixing, bool grey = false);

}  // namespace evs
