// How things look, ready for the kernels: lights, surfaces, and textures with the surface's colour
// in them.
#pragma once

#include <memory>
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
  std::vector<std::shared_ptr<const Chain>> chains;
  struct Baked {  // which chain is which texture in which colour
    int texture;
    float key[3];
    int index;
  };
  std::vector<Baked> baked;
  std::vector<Texture> textures;  // views of the chains
  int skybox;                     // index into textures, -1 none
  bool textured;                  // a surface has an image
  bool layered;                   // a surface is physical or has maps
  bool bumpy;                     // a surface has a normal map
  Air air;                        // but for where the camera is
};

// rgb: colour is wanted, whatever the lights are; the luminance keeps its bytes. mixing: light goes
// from surface to surface, which needs its colour: three channels. grey: lights lose their colour
// instead (for tests). before: of the scene that was shown before, whose chains are taken over
// where the image is the same, or null.
Appearance make_appearance(const SceneData& scene, bool rgb, bool mixing, bool grey = false,
                           const Appearance* before = nullptr);

}  // namespace evs
