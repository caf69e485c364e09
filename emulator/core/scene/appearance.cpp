#include "scene/appearance.h"

#include <algorithm>
#include <cmath>

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

constexpr int WIDEST = 64;  // texels across a face: finer than anything that order 2 can resolve

// solid angle of the face's corner (0, 0) ... (s, t), seen from the cube's centre
double corner_angle(double s, double t) { return std::atan2(s * t, std::sqrt(s * s + t * t + 1)); }

// direction in the world of a point on a face (-1 ... 1): the inverse of cube_coordinates(), y up
// in the image
void direction_of(int face, double s, double t, double* d) {
  double axes[6][3] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t}, {s, -1, -t}, {s, -t, 1}, {-s, -t, -1}};
  const double* q = axes[face];
  double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
  d[0] = q[0] / n;
  d[1] = -q[2] / n;
  d[2] = q[1] / n;
}

void basis_of(const double* d, double* y) {
  double x = d[0], v = d[1], z = d[2];
  double values[9] = {1, v, z, x, x * v, v * z, 3 * z * z - 1, x * z, x * x - v * v};
  for (int i = 0; i < 9; i++) y[i] = values[i];
}

// squared norm of each basis function over the sphere, times 1 / (4 pi)
constexpr double NORM[9] = {1,        1.0 / 3, 1.0 / 3,  1.0 / 3, 1.0 / 15,
                            1.0 / 15, 4.0 / 5, 1.0 / 15, 4.0 / 15};
// attenuation of each order by the cosine lobe, over pi
constexpr double LOBE[9] = {1, 2.0 / 3, 2.0 / 3, 2.0 / 3, 0.25, 0.25, 0.25, 0.25, 0.25};

// Project an environment's irradiance over pi on spherical harmonics up to order 2: mean error
// about 1 % (Ramamoorthi and Hanrahan 2001), 0 for a uniform environment. In: image (6 faces),
// linear light. Out: coefficients (9) of channel `channel`, in the order of Light::harmonics, in
// the world's frame.
void project_irradiance(const MipChain& image, int channel, float* factors) {
  const Texture& t = image.layout;
  int level = 0;
  while (level + 1 < t.levels && t.level[level].width > WIDEST) level++;
  int w = t.level[level].width, h = t.level[level].height;
  double sum[9] = {}, sphere = 0;
  for (int face = 0; face < 6; face++) {
    for (int y = 0; y < h; y++) {
      for (int x = 0; x < w; x++) {
        double s0 = 2.0 * x / w - 1, s1 = 2.0 * (x + 1) / w - 1;
        double t0 = 2.0 * y / h - 1, t1 = 2.0 * (y + 1) / h - 1;
        double angle = corner_angle(s1, t1) - corner_angle(s0, t1) - corner_angle(s1, t0) +
                       corner_angle(s0, t0);
        double d[3], basis[9];
        direction_of(face, 0.5 * (s0 + s1), 0.5 * (t0 + t1), d);
        basis_of(d, basis);
        double light = image.texels[t.at(channel, level, face, y + 1, x + 1)] * angle;
        for (int i = 0; i < 9; i++) sum[i] += light * basis[i];
        sphere += angle;
      }
    }
  }
  for (int i = 0; i < 9; i++) {
    factors[i] = static_cast<float>(sum[i] / sphere / NORM[i] * LOBE[i]);
  }
}

// Bake textures for the kernels, each use once: the image times a colour, or its plain numbers.
class TextureBaker {
 public:
  TextureBaker(const SceneData& scene, Appearance& appearance, const Appearance* before)
      : scene_(scene), appearance_(appearance), before_(before) {}

  // the image times a display-coded colour; -1 stays -1
  int color(int texture, const float* rgba) {
    return find(texture, rgba, [&](const SceneData::TextureData& t) {
      float tint[3];
      for (int c = 0; c < 3; c++) tint[c] = from_srgb(rgba[c]);
      return build_mip_chain(t.data.data(), t.faces, t.height, t.width, t.components, t.srgb, tint,
                             appearance_.channels);
    });
  }

  // its first component as a number; -1 stays -1
  int number(int texture) {
    constexpr float KEY[3] = {-1, 1, 0};
    return find(texture, KEY, [&](const SceneData::TextureData& t) {
      return build_scalar_mip_chain(t.data.data(), t.faces, t.height, t.width, t.components,
                                    t.srgb);
    });
  }

  // normals; -1 stays -1
  int normals(int texture) {
    constexpr float KEY[3] = {-1, 3, 0};
    return find(texture, KEY, [&](const SceneData::TextureData& t) {
      return build_normal_mip_chain(t.data.data(), t.faces, t.height, t.width, t.components,
                                    t.srgb);
    });
  }

 private:
  template <class Build>
  int find(int texture, const float* key, Build&& build) {
    if (texture < 0) return -1;
    int index = place_of(appearance_, texture, key);
    if (index >= 0) return index;
    // colours are laid out by channel
    int like =
        before_ && before_->channels == appearance_.channels ? scene_.textures[texture].like : -1;
    int old = like >= 0 ? place_of(*before_, like, key) : -1;
    appearance_.chains.push_back(
        old >= 0 ? before_->chains[old]
                 : std::make_shared<const MipChain>(build(scene_.textures[texture])));
    index = static_cast<int>(appearance_.chains.size()) - 1;
    appearance_.baked.push_back({texture, {key[0], key[1], key[2]}, index});
    return index;
  }

  static int place_of(const Appearance& appearance, int texture, const float* key) {
    for (const Appearance::Baked& b : appearance.baked) {
      if (b.texture == texture && std::equal(key, key + 3, b.key)) return b.index;
    }
    return -1;
  }

  const SceneData& scene_;
  Appearance& appearance_;
  const Appearance* before_;
};

// Is every texel grey? Then grey lights stay grey through it.
bool is_grey(const SceneData::TextureData& t) {
  for (size_t i = 0; t.components >= 3 && i < t.data.size(); i += t.components) {
    if (t.data[i] != t.data[i + 1] || t.data[i] != t.data[i + 2]) return false;
  }
  return true;
}

// What channel c holds: -1 luminance, else red, green, blue.
int component_of(int channels, int c) { return channels == 1 ? -1 : c - (channels - 3); }

// Convert a linear colour to the scene's channels, followed by its luminance.
void to_channels(const float* linear, int channels, float* out) {
  for (int c = 0; c < channels; c++) {
    int k = component_of(channels, c);
    out[c] = k >= 0 ? linear[k] : luminance_of(linear);
  }
  out[channels] = luminance_of(linear);
}

void choose_channels(const SceneData& scene, bool rgb, bool mixing, bool as_grey, Appearance& out) {
  bool grey = !mixing;
  for (const LightData& l : scene.lights) {
    grey = grey && is_grey(l.ambient) && is_grey(l.diffuse) && is_grey(l.specular);
    if (l.is_image()) grey = grey && is_grey(scene.textures[l.texture]);
  }
  grey = grey || (as_grey && !mixing);
  out.channels = !grey ? 3 : rgb ? 4 : 1;
  out.weights[0] = 1.0f;
  if (!grey) std::copy(WEIGHTS, WEIGHTS + 3, out.weights);
}

// An image's texels are radiance: times `diffuse`, or times an intensity in cd/m^2 (pi lux on what
// it surrounds).
void add_image(const LightData& l, const Appearance& appearance, Light& light) {
  for (int c = 0; c < appearance.channels; c++) {
    int k = appearance.channels == 3 ? c : 0;
    light.ambient[c] = light.specular[c] = 0;
    light.diffuse[c] = l.intensity > 0 ? PI * l.intensity : l.diffuse[k];
    project_irradiance(*appearance.chains[light.texture], c, light.harmonics[c]);
  }
  int more = appearance.channels;
  light.ambient[more] = light.specular[more] = 0;
  light.diffuse[more] = l.intensity > 0 ? PI * l.intensity : luminance_of(l.diffuse);
  for (int i = 0; i < 9; i++) {
    float part[3] = {light.harmonics[0][i], light.harmonics[1][i], light.harmonics[2][i]};
    light.harmonics[more][i] = appearance.channels == 3 ? luminance_of(part) : part[0];
  }
}

void add_lights(const SceneData& scene, TextureBaker& baker, Appearance& out) {
  for (const LightData& l : scene.lights) {
    Light light = {};
    static_cast<LightBase&>(light) = l;
    light.castshadow = l.castshadow && !l.is_image();
    light.texture = -1;
    float scale = l.intensity > 0 ? l.intensity : 1.0f;
    light.inverse_square = l.intensity > 0 && !l.is_delta_direction();
    for (int c = 0; c < out.channels; c++) {
      int k = out.channels == 3 ? c : 0;
      light.ambient[c] = l.intensity > 0 ? 0.0f : l.ambient[k];
      light.diffuse[c] = scale * l.diffuse[k];
      light.specular[c] = scale * l.specular[k];
    }
    light.ambient[out.channels] = l.intensity > 0 ? 0.0f : luminance_of(l.ambient);
    light.diffuse[out.channels] = scale * luminance_of(l.diffuse);
    light.specular[out.channels] = scale * luminance_of(l.specular);
    light.cos_cutoff = static_cast<float>(std::cos(l.cutoff_deg * RADIANS));
    light.radius = std::max(l.radius, 0.0f);
    if (light.inverse_square) {
      light.fade = l.range > 0 ? 1.0f / (l.range * l.range) : 0.0f;
      // as in MuJoCo's physical renderer: full light inside, none at the cutoff
      double inner = std::cos((1.0 - l.softness) * l.cutoff_deg * RADIANS);
      light.edge =
          static_cast<float>(1.0 / std::max(inner - std::cos(l.cutoff_deg * RADIANS), 1.0 / 1024));
    }
    if (l.is_image()) {
      light.texture = baker.color(l.texture, WHITE);
      add_image(l, out, light);
    }
    out.lights.push_back(light);
    out.headlight.push_back(l.headlight);
  }
}

// Set physical parameters and maps; a map multiplies its parameter.
void add_maps(const SceneData::SurfaceData& s, TextureBaker& baker, Surface& out) {
  out.physical = s.metallic >= 0 || s.roughness >= 0 || s.metallic_map >= 0 || s.roughness_map >= 0;
  out.metallic_map = baker.number(s.metallic_map);
  out.roughness_map = baker.number(s.roughness_map);
  out.occlusion_map = baker.number(s.occlusion_map);
  out.opacity_map = baker.number(s.opacity_map);
  out.normal_map = baker.normals(s.normal_map);
  out.emissive_map = baker.color(s.emissive_map, WHITE);
  out.layered = out.metallic_map >= 0 || out.roughness_map >= 0 || out.occlusion_map >= 0 ||
                out.opacity_map >= 0 || out.normal_map >= 0 || out.emissive_map >= 0;
  if (out.emissive_map >= 0 && !(s.emission > 0)) out.emission = 1;
  if (!out.physical) return;
  out.metallic = s.metallic >= 0 ? s.metallic : (s.metallic_map >= 0 ? 1.0f : 0.0f);
  out.roughness = s.roughness >= 0 ? s.roughness : 1.0f;
  float rough = std::max(out.roughness, MIN_ROUGHNESS);
  out.alpha_ggx = rough * rough;
}

void add_surfaces(const SceneData& scene, TextureBaker& baker, Appearance& appearance) {
  for (const SceneData::SurfaceData& s : scene.surfaces) {
    Surface out = {};
    float linear[3];
    for (int c = 0; c < 3; c++) linear[c] = from_srgb(s.rgba[c]);
    to_channels(linear, appearance.channels, out.albedo);
    out.emission = s.emission;
    out.specular = from_srgb(s.specular);
    // negative exponents are meaningless: clamp to 0
    out.exponent = std::max(s.shininess, 0.0f) * 128.0f;
    out.alpha = std::min(s.rgba[3], 1.0f);
    // the GGX lobe nearest to Blinn-Phong's; specular 0.5 reflects like most dielectrics
    out.alpha_ggx = static_cast<float>(std::sqrt(2.0 / (out.exponent + 2.0)));
    out.f0 = 0.08f * std::clamp(s.specular, 0.0f, 1.0f);
    out.reflectance = out.alpha < 1 ? 0.0f : s.reflectance;
    out.texture = baker.color(s.texture, s.rgba);
    for (int k = 0; k < 2; k++) out.repeat[k] = s.repeat[k] > 0 ? s.repeat[k] : 1.0f;
    out.uniform = s.uniform;
    add_maps(s, baker, out);
    appearance.textured = appearance.textured || out.texture >= 0 || out.layered;
    appearance.layered = appearance.layered || out.layered || out.physical;
    appearance.normal_mapped = appearance.normal_mapped || out.normal_map >= 0;
    appearance.surfaces.push_back(out);
  }
  appearance.skybox = baker.color(scene.skybox, WHITE);
  appearance.sky_shines = scene.sky_shines && appearance.skybox >= 0;
}

void apply_medium(const SceneData::MediumData& data, Appearance& appearance) {
  Medium& medium = appearance.medium;
  medium.fog = data.fog;
  medium.fog_end = data.fog_end;
  // an end before the start makes a wall of fog
  medium.fog_slope = 1.0f / std::max(data.fog_end - data.fog_start, 1e-6f);
  medium.haze_ratio = data.haze_ratio;
  medium.haze_radius = data.haze_radius;
  // where MuJoCo's cone turns from fading in to fading out, from the ratio
  double inner = std::atan2(1.0, data.haze_ratio);
  medium.haze_peak = static_cast<float>(std::sqrt(0.5) * data.haze_ratio * std::sin(inner) /
                                        std::sin(135 * RADIANS - inner));
  medium.haze = data.haze && data.haze_radius > 0 && medium.haze_peak > 0 && medium.haze_peak < 1;
  for (int i = 0; i < 2; i++) {
    const float* coded = i ? data.haze_color : data.fog_color;
    float* color = i ? medium.haze_color : medium.fog_color;
    float linear[3];
    for (int c = 0; c < 3; c++) linear[c] = from_srgb(coded[c]);
    to_channels(linear, appearance.channels, color);
  }
}

}  // namespace

Appearance make_appearance(const SceneData& scene, bool rgb, bool mixing, bool grey,
                           const Appearance* before) {
  Appearance appearance = {};
  choose_channels(scene, rgb, mixing, grey, appearance);
  TextureBaker baker(scene, appearance, before);
  add_lights(scene, baker, appearance);
  add_surfaces(scene, baker, appearance);
  apply_medium(scene.medium, appearance);
  for (const auto& chain : appearance.chains) appearance.textures.push_back(chain->view());
  return appearance;
}

namespace {

// Of luminance, red, green, blue and the luminance `untextured`, keep the first and the last, or
// all but the first.
void select(const float* all, bool colours, float* out) {
  float kept[4] = {all[0], all[4], 0, 0};
  if (colours) std::copy(all + 1, all + 5, kept);
  std::copy(kept, kept + 4, out);
}

}  // namespace

void select_channels(const Light& all, bool colours, Light& out) {
  out = all;
  select(all.ambient, colours, out.ambient);
  select(all.diffuse, colours, out.diffuse);
  select(all.specular, colours, out.specular);
}

Appearance select_channels(const Appearance& all, bool colours) {
  Appearance out = all;
  out.channels = colours ? 3 : 1;
  if (colours) std::copy(WEIGHTS, WEIGHTS + 3, out.weights);
  for (size_t i = 0; i < all.lights.size(); i++)
    select_channels(all.lights[i], colours, out.lights[i]);
  for (Surface& s : out.surfaces) select(s.albedo, colours, s.albedo);
  select(all.medium.fog_color, colours, out.medium.fog_color);
  select(all.medium.haze_color, colours, out.medium.haze_color);
  for (const Appearance::Baked& baked : all.baked) {
    if (baked.key[0] < 0) continue;  // numbers and normals
    Texture& t = out.textures[baked.index];
    t.channels = out.channels;
    if (colours) t.texels += 2 * static_cast<long>(t.channel_stride);
  }
  return out;
}

void mean_colour(const Surface& surface, const Appearance& appearance, float* rgb) {
  std::copy(surface.albedo, surface.albedo + 3, rgb);
  if (surface.texture < 0) return;
  const Texture& t = appearance.textures[surface.texture];
  for (int c = 0; c < 3; c++) {
    rgb[c] = 0;  // the last level is one texel
    for (int face = 0; face < t.faces; face++)
      rgb[c] += t.texels[t.at(c, t.levels - 1, face, 1, 1)] / static_cast<float>(t.faces);
  }
}

}  // namespace evs
