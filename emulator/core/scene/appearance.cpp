#include "appearance.h"

#include <algorithm>
#include <cmath>

#include "environment.h"

namespace evs {
namespace {

constexpr float WEIGHTS[3] = {0.2126f, 0.7152f, 0.0722f};  // BT.709

bool is_grey(const float* c) { return c[0] == c[1] && c[1] == c[2]; }

float luminance_of(const float* c) {
  return WEIGHTS[0] * c[0] + WEIGHTS[1] * c[1] + WEIGHTS[2] * c[2];
}

constexpr double RADIANS = 3.14159265358979 / 180;
constexpr float PI = 3.14159265f;
constexpr float WHITE[3] = {1, 1, 1};

// Textures ready for the kernels, each use once: the image times a colour, or its bare numbers.
class Bakery {
 public:
  Bakery(const SceneData& scene, Appearance& look, const Appearance* before)
      : scene_(scene), look_(look), before_(before) {}

  // the image times a display-coded colour; -1 stays -1
  int color(int texture, const float* rgba) {
    return find(texture, rgba, [&](const SceneData::TextureData& t) {
      float tint[3];
      for (int c = 0; c < 3; c++) tint[c] = from_srgb(rgba[c]);
      return build_chain(t.data.data(), t.faces, t.height, t.width, t.components, t.srgb, tint,
                         look_.channels);
    });
  }

  // its first component as a number; -1 stays -1
  int number(int texture) {
    constexpr float KEY[3] = {-1, 1, 0};
    return find(texture, KEY, [&](const SceneData::TextureData& t) {
      return build_number_chain(t.data.data(), t.faces, t.height, t.width, t.components, t.srgb);
    });
  }

  // normals; -1 stays -1
  int normals(int texture) {
    constexpr float KEY[3] = {-1, 3, 0};
    return find(texture, KEY, [&](const SceneData::TextureData& t) {
      return build_normal_chain(t.data.data(), t.faces, t.height, t.width, t.components, t.srgb);
    });
  }

 private:
  template <class Build>
  int find(int texture, const float* key, Build&& build) {
    if (texture < 0) return -1;
    int index = place_of(look_, texture, key);
    if (index >= 0) return index;
    // colours are laid out by channel
    int like = before_ && before_->channels == look_.channels ? scene_.textures[texture].like : -1;
    int old = like >= 0 ? place_of(*before_, like, key) : -1;
    look_.chains.push_back(old >= 0
                               ? before_->chains[old]
                               : std::make_shared<const Chain>(build(scene_.textures[texture])));
    index = static_cast<int>(look_.chains.size()) - 1;
    look_.baked.push_back({texture, {key[0], key[1], key[2]}, index});
    return index;
  }

  static int place_of(const Appearance& look, int texture, const float* key) {
    for (const Appearance::Baked& b : look.baked) {
      if (b.texture == texture && std::equal(key, key + 3, b.key)) return b.index;
    }
    return -1;
  }

  const SceneData& scene_;
  Appearance& look_;
  const Appearance* before_;
};

// Grey in every texel; then grey lights stay grey through it.
bool is_grey(const SceneData::TextureData& t) {
  for (size_t i = 0; t.components >= 3 && i < t.data.size(); i += t.components) {
    if (t.data[i] != t.data[i + 1] || t.data[i] != t.data[i + 2]) return false;
  }
  return true;
}

// What channel c carries: -1 luminance, else red, green, blue.
int part_of(int channels, int c) { return channels == 1 ? -1 : c - (channels - 3); }

// A linear colour in the scene's channels, and its luminance once more.
void spread(const float* linear, int channels, float* out) {
  for (int c = 0; c < channels; c++) {
    int k = part_of(channels, c);
    out[c] = k >= 0 ? linear[k] : luminance_of(linear);
  }
  out[channels] = luminance_of(linear);
}

void choose_channels(const SceneData& scene, bool rgb, bool mixing, bool as_grey, Appearance& out) {
  bool grey = !mixing;
  for (const SceneData::LightData& l : scene.lights) {
    grey = grey && is_grey(l.ambient) && is_grey(l.diffuse) && is_grey(l.specular);
    if (l.kind == IMAGE) grey = grey && is_grey(scene.textures[l.texture]);
  }
  grey = grey || (as_grey && !mixing);
  out.channels = !grey ? 3 : rgb ? 4 : 1;
  out.weights[0] = 1.0f;
  if (!grey) std::copy(WEIGHTS, WEIGHTS + 3, out.weights);
}

// An image's texels are its radiance: times `diffuse`, or with an intensity in cd/m^2 (pi lux on
// what it surrounds).
void add_image(const SceneData::LightData& l, const Appearance& look, Light& light) {
  for (int c = 0; c < look.channels; c++) {
    int k = look.channels == 3 ? c : 0;
    light.ambient[c] = light.specular[c] = 0;
    light.diffuse[c] = l.intensity > 0 ? PI * l.intensity : l.diffuse[k];
    project_irradiance(*look.chains[light.texture], c, light.harmonics[c]);
  }
  int more = look.channels;
  light.ambient[more] = light.specular[more] = 0;
  light.diffuse[more] = l.intensity > 0 ? PI * l.intensity : luminance_of(l.diffuse);
  for (int i = 0; i < 9; i++) {
    float part[3] = {light.harmonics[0][i], light.harmonics[1][i], light.harmonics[2][i]};
    light.harmonics[more][i] = look.channels == 3 ? luminance_of(part) : part[0];
  }
}

void add_lights(const SceneData& scene, Bakery& bakery, Appearance& out) {
  for (const SceneData::LightData& l : scene.lights) {
    Light light = {};
    light.kind = l.kind;
    light.castshadow = l.castshadow && l.kind != IMAGE;
    light.texture = -1;
    float scale = l.intensity > 0 ? l.intensity : 1.0f;
    light.inverse_square = l.intensity > 0 && l.kind != DIRECTIONAL;
    for (int c = 0; c < out.channels; c++) {
      int k = out.channels == 3 ? c : 0;
      light.ambient[c] = l.intensity > 0 ? 0.0f : l.ambient[k];
      light.diffuse[c] = scale * l.diffuse[k];
      light.specular[c] = scale * l.specular[k];
    }
    light.ambient[out.channels] = l.intensity > 0 ? 0.0f : luminance_of(l.ambient);
    light.diffuse[out.channels] = scale * luminance_of(l.diffuse);
    light.specular[out.channels] = scale * luminance_of(l.specular);
    std::copy(l.attenuation, l.attenuation + 3, light.attenuation);
    light.cos_cutoff = static_cast<float>(std::cos(l.cutoff_deg * RADIANS));
    light.exponent = l.exponent;
    light.radius = std::max(l.bulbradius, 0.0f);
    if (light.inverse_square) {
      light.fade = l.range > 0 ? 1.0f / (l.range * l.range) : 0.0f;
      // as MuJoCo's physical renderer: full light inside, none at the cutoff
      double inner = std::cos((1.0 - l.softness) * l.cutoff_deg * RADIANS);
      light.edge =
          static_cast<float>(1.0 / std::max(inner - std::cos(l.cutoff_deg * RADIANS), 1.0 / 1024));
    }
    if (l.kind == IMAGE) {
      light.texture = bakery.color(l.texture, WHITE);
      add_image(l, out, light);
    }
    out.lights.push_back(light);
    out.headlight.push_back(l.headlight);
  }
}

// What makes a material physical, and the maps; a map multiplies the number beside it.
void add_layers(const SceneData::SurfaceData& s, Bakery& bakery, Surface& out) {
  out.physical = s.metallic >= 0 || s.roughness >= 0 || s.metallic_map >= 0 || s.roughness_map >= 0;
  out.metallic_map = bakery.number(s.metallic_map);
  out.roughness_map = bakery.number(s.roughness_map);
  out.occlusion_map = bakery.number(s.occlusion_map);
  out.opacity_map = bakery.number(s.opacity_map);
  out.normal_map = bakery.normals(s.normal_map);
  out.emissive_map = bakery.color(s.emissive_map, WHITE);
  out.layered = out.metallic_map >= 0 || out.roughness_map >= 0 || out.occlusion_map >= 0 ||
                out.opacity_map >= 0 || out.normal_map >= 0 || out.emissive_map >= 0;
  if (out.emissive_map >= 0 && !(s.emission > 0)) out.emission = 1;
  if (!out.physical) return;
  out.metallic = s.metallic >= 0 ? s.metallic : (s.metallic_map >= 0 ? 1.0f : 0.0f);
  out.roughness = s.roughness >= 0 ? s.roughness : 1.0f;
  float rough = std::max(out.roughness, MIN_ROUGHNESS);
  out.alpha_ggx = rough * rough;
}

void add_surfaces(const SceneData& scene, Bakery& bakery, Appearance& look) {
  for (const SceneData::SurfaceData& s : scene.surfaces) {
    Surface out = {};
    float linear[3];
    for (int c = 0; c < 3; c++) linear[c] = from_srgb(s.rgba[c]);
    spread(linear, look.channels, out.albedo);
    out.emission = s.emission;
    out.specular = from_srgb(s.specular);
    // a negative exponent has no meaning: it counts as none
    out.exponent = std::max(s.shininess, 0.0f) * 128.0f;
    out.alpha = std::min(s.rgba[3], 1.0f);
    // the GGX lobe nearest to Blinn-Phong's; specular 0.5 reflects as most dielectrics do
    out.alpha_ggx = static_cast<float>(std::sqrt(2.0 / (out.exponent + 2.0)));
    out.f0 = 0.08f * std::clamp(s.specular, 0.0f, 1.0f);
    out.reflectance = out.alpha < 1 ? 0.0f : s.reflectance;
    out.texture = bakery.color(s.texture, s.rgba);
    for (int k = 0; k < 2; k++) out.repeat[k] = s.repeat[k] > 0 ? s.repeat[k] : 1.0f;
    out.uniform = s.uniform;
    add_layers(s, bakery, out);
    look.textured = look.textured || out.texture >= 0 || out.layered;
    look.layered = look.layered || out.layered || out.physical;
    look.bumpy = look.bumpy || out.normal_map >= 0;
    look.surfaces.push_back(out);
  }
  look.skybox = bakery.color(scene.skybox, WHITE);
}

void add_air(const SceneData::AirData& data, Appearance& look) {
  Air& air = look.air;
  air.fog = data.fog;
  air.fog_end = data.fog_end;
  // an end before the start: a wall of fog
  air.fog_slope = 1.0f / std::max(data.fog_end - data.fog_start, 1e-6f);
  air.haze_ratio = data.haze_ratio;
  air.haze_radius = data.haze_radius;
  // where MuJoCo's cone turns from fading in to fading out, from the ratio
  double inner = std::atan2(1.0, data.haze_ratio);
  air.haze_peak = static_cast<float>(std::sqrt(0.5) * data.haze_ratio * std::sin(inner) /
                                     std::sin(135 * RADIANS - inner));
  air.haze = data.haze && data.haze_radius > 0 && air.haze_peak > 0 && air.haze_peak < 1;
  for (int i = 0; i < 2; i++) {
    const float* coded = i ? data.haze_color : data.fog_color;
    float* color = i ? air.haze_color : air.fog_color;
    float linear[3];
    for (int c = 0; c < 3; c++) linear[c] = from_srgb(coded[c]);
    spread(linear, look.channels, color);
  }
}

}  // namespace

Appearance make_appearance(const SceneData& scene, bool rgb, bool mixing, bool grey,
                           const Appearance* before) {
  Appearance look = {};
  choose_channels(scene, rgb, mixing, grey, look);
  Bakery bakery(scene, look, before);
  add_lights(scene, bakery, look);
  add_surfaces(scene, bakery, look);
  add_air(scene.air, look);
  for (const auto& chain : look.chains) look.textures.push_back(chain->view());
  return look;
}

}  // namespace evs
