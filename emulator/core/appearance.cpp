#include "appearance.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr float WEIGHTS[3] = {0.2126f, 0.7152f, 0.0722f};  // BT.709

bool is_grey(const float* c) { return c[0] == c[1] && c[1] == c[2]; }

float luminance_of(const float* c) {
  return WEIGHTS[0] * c[0] + WEIGHTS[1] * c[1] + WEIGHTS[2] * c[2];
}

void add_lights(const SceneData& scene, bool rgb, Appearance& out) {
  bool grey = true;
  for (const SceneData::LightData& l : scene.lights) {
    grey = grey && is_grey(l.ambient) && is_grey(l.diffuse) && is_grey(l.specular);
  }
  out.channels = !grey ? 3 : rgb ? 4 : 1;
  out.weights[0] = 1.0f;
  if (!grey) std::copy(WEIGHTS, WEIGHTS + 3, out.weights);
  for (const SceneData::LightData& l : scene.lights) {
    Light light = {};
    light.kind = l.kind;
    light.castshadow = l.castshadow;
    float scale = l.intensity > 0 ? l.intensity : 1.0f;
    light.inverse_square = l.intensity > 0 && l.kind != DIRECTIONAL;
    for (int c = 0; c < out.channels; c++) {
      int k = out.channels == 3 ? c : 0;
      light.ambient[c] = l.intensity > 0 ? 0.0f : l.ambient[k];
      light.diffuse[c] = scale * l.diffuse[k];
      light.specular[c] = scale * l.specular[k];
    }
    std::copy(l.attenuation, l.attenuation + 3, light.attenuation);
    light.cos_cutoff = static_cast<float>(std::cos(l.cutoff_deg * 3.14159265358979 / 180));
    light.exponent = l.exponent;
    out.lights.push_back(light);
    out.headlight.push_back(l.headlight);
  }
}

void add_surfaces(const SceneData& scene, Appearance& look) {
  struct Baked {
    int texture;
    float rgba[3];
    int index;
  };
  std::vector<Baked> baked;
  // the image times the surface's colour, once for each pair
  auto bake = [&](int texture, const float* rgba) {
    for (const Baked& b : baked) {
      if (b.texture == texture && std::equal(rgba, rgba + 3, b.rgba)) return b.index;
    }
    const SceneData::TextureData& t = scene.textures[texture];
    float tint[3];
    for (int c = 0; c < 3; c++) tint[c] = from_srgb(rgba[c]);
    look.chains.push_back(build_chain(t.data.data(), t.faces, t.height, t.width, t.components,
                                      t.srgb, tint, look.channels));
    int index = static_cast<int>(look.chains.size()) - 1;
    baked.push_back({texture, {rgba[0], rgba[1], rgba[2]}, index});
    return index;
  };
  for (const SceneData::SurfaceData& s : scene.surfaces) {
    Surface out = {};
    float linear[3];
    for (int c = 0; c < 3; c++) linear[c] = from_srgb(s.rgba[c]);
    for (int c = 0; c < look.channels; c++) {
      int k = look.channels == 1 ? -1 : c - (look.channels - 3);
      out.albedo[c] = k >= 0 ? linear[k] : luminance_of(linear);
    }
    out.emission = s.emission;
    out.specular = from_srgb(s.specular);
    // a negative exponent has no meaning: it counts as none
    out.exponent = std::max(s.shininess, 0.0f) * 128.0f;
    out.alpha = std::min(s.rgba[3], 1.0f);
    // the GGX lobe nearest to Blinn-Phong's; specular 0.5 reflects as most dielectrics do
    out.alpha_ggx = static_cast<float>(std::sqrt(2.0 / (out.exponent + 2.0)));
    out.f0 = 0.08f * out.specular;
    out.reflectance = out.alpha < 1 ? 0.0f : s.reflectance;
    out.texture = s.texture < 0 ? -1 : bake(s.texture, s.rgba);
    for (int k = 0; k < 2; k++) out.repeat[k] = s.repeat[k] > 0 ? s.repeat[k] : 1.0f;
    out.uniform = s.uniform;
    look.surfaces.push_back(out);
  }
  constexpr float WHITE[3] = {1, 1, 1};
  look.skybox = scene.skybox < 0 ? -1 : bake(scene.skybox, WHITE);
  for (const Chain& chain : look.chains) look.textures.push_back(chain.view());
}

}  // namespace

Appearance make_appearance(const SceneData& scene, bool rgb) {
  Appearance look = {};
  add_lights(scene, rgb, look);
  add_surfaces(scene, look);
  return look;
}

}  // namespace evs
