// The scene's appearance, ready for the kernels: lights, surfaces, and textures with the surface's
// colour baked in.
#pragma once

#include <memory>
#include <vector>

#include "scene/mipmap.h"
#include "scene/scene.h"
#include "scene/scene_data.h"

namespace evs {

struct Appearance {
  // 1: luminance only, as every light is grey; 3: RGB; 4: luminance, with the same bytes as with 1,
  // followed by RGB. Lights and surfaces have one channel more, the luminance, for frames that
  // carry it `untextured`.
  int channels;
  float weights[MAX_CHANNELS];  // luminance of each channel
  std::vector<Light> lights;
  std::vector<bool> headlight;  // of each light
  std::vector<Surface> surfaces;
  std::vector<std::shared_ptr<const MipChain>> chains;
  struct Baked {  // which mip chain is which texture in which colour
    int texture;
    float key[3];
    int index;
  };
  std::vector<Baked> baked;
  std::vector<Texture> textures;  // views of the chains
  int skybox;                     // index into textures, -1 none
  bool sky_shines;                // else the skybox is a backdrop
  bool textured;                  // a surface has an image
  bool layered;                   // a surface is physical or has maps
  bool normal_mapped;             // a surface has a normal map
  Medium medium;                  // without the camera's position
};

// rgb: compute colour even if the lights are grey; the luminance keeps its bytes. mixing: light is
// reflected between surfaces, which needs three channels. grey: ignore the lights' colour (for
// tests). before: the previous scene's appearance, whose mip chains are reused for equal images, or
// null.
Appearance make_appearance(const SceneData& scene, bool rgb, bool mixing, bool grey = false,
                           const Appearance* before = nullptr);

// Some channels of an appearance that has four: its luminance alone, or its colours. It shares the
// texels.
Appearance select_channels(const Appearance& all, bool colours);
void select_channels(const Light& all, bool colours, Light& out);

// Mean colour of a surface.
void mean_colour(const Surface& surface, const Appearance& appearance, float* rgb);

}  // namespace evs
