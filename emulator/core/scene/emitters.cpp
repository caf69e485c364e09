#include "scene/emitters.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr double PI = 3.14159265358979323846;
constexpr double WEIGHTS[3] = {0.2126, 0.7152, 0.0722};  // BT.709
// Skies whose brightest cell has less than this many times their mean are not sampled. Skies of 3.8
// times their mean have as much noise in a given time with as without.
constexpr double PEAK = 4.0;

// Area of a shape's front in m^2; 0: it cannot be sampled.
double area_of(int shape, const float* size) {
  double a = size[0], b = size[1], c = size[2];
  switch (shape) {
    case PLANE:
      return a > 0 && b > 0 ? 4 * a * b : 0;
    case SPHERE:
      return 4 * PI * a * a;
    case CAPSULE:
      return 4 * PI * a * (a + b);
    case CYLINDER:
      return 2 * PI * a * (a + 2 * b);
    case BOX:
      return 8 * (a * b + b * c + c * a);
    case ELLIPSOID:
      return 4 * PI;
    default:
      return 0;
  }
}

// The axis about which a shape is the same however it turns, or -1.
int axis_of(int shape, const float* size) {
  if (shape == CAPSULE || shape == CYLINDER) return 2;
  for (int a = 2; a >= 0 && shape == ELLIPSOID; a--) {
    if (size[(a + 1) % 3] == size[(a + 2) % 3]) return a;
  }
  return -1;
}

std::vector<float> triangle_shares(const Bvh& bvh, double& area) {
  std::vector<double> sums;
  area = 0;
  for (const Triangle& t : bvh.triangles) {
    double x = t.normal.x, y = t.normal.y, z = t.normal.z;
    double twice = std::sqrt(x * x + y * y + z * z);
    area += std::isfinite(twice) ? 0.5 * twice : 0;
    sums.push_back(area);
  }
  std::vector<float> shares;
  for (double sum : sums) shares.push_back(static_cast<float>(sum / std::max(area, 1e-300)));
  return shares;
}

// Append a guide table to a CDF: for each of `count` equal parts of 0 ... 1, the first entry that a
// number in it may select. It is slightly early, because products are rounded.
void add_guide(const float* table, int count, std::vector<int32_t>& guide) {
  int entry = 0;
  for (int k = 0; k < count; k++) {
    float least = static_cast<float>(k) / static_cast<float>(count) * 0.999999f;
    while (entry + 1 < count && table[entry] <= least) entry++;
    guide.push_back(entry);
  }
}

// Mean luminance of a mip chain.
double luminance_of(const Texture& t) {
  double sum = 0;  // the last level is one texel
  for (int c = 0; c < 3; c++) {
    for (int face = 0; face < t.faces; face++) {
      sum += WEIGHTS[c] * t.texels[t.at(c, t.levels - 1, face, 1, 1)];
    }
  }
  return sum / t.faces;
}

// Mean radiance of an emissive surface with an emission of 1.
double luminance_of(const Surface& s, const Appearance& appearance) {
  if (s.emissive_map >= 0) return luminance_of(appearance.textures[s.emissive_map]);
  if (s.texture >= 0) return luminance_of(appearance.textures[s.texture]);
  return WEIGHTS[0] * s.albedo[0] + WEIGHTS[1] * s.albedo[1] + WEIGHTS[2] * s.albedo[2];
}

}  // namespace

Emitters::Emitters(const SceneData& scene, const Appearance& appearance,
                   const std::vector<int>& order) {
  for (const Light& light : appearance.lights) {
    // the ambient part of other lights fades with distance and cone, so it is no environment
    if (!light.is_delta_direction()) continue;
    for (int c = 0; c < 3; c++) ambient_radiance_[c] += std::max(light.ambient[c], 0.0f);
  }
  for (const Light& light : appearance.lights) lamp_count_ += !light.is_image();
  has_environment_ = appearance.sky_shines ||
                     lamp_count_ < static_cast<int>(appearance.lights.size()) ||
                     ambient_radiance_[0] + ambient_radiance_[1] + ambient_radiance_[2] > 0;
  for (size_t k = 0; k < order.size(); k++) {
    int g = order[k], shape = scene.geom_type[g];
    const Surface& surface = appearance.surfaces[scene.geom_surface[g]];
    if (surface.transparent()) transparent_geoms_.push_back(static_cast<int>(k));
    double radiance = surface.emission * luminance_of(surface, appearance);
    if (!(surface.emission > 0)) continue;
    emissive_ = true;
    const float* size = &scene.geom_size[3 * static_cast<size_t>(g)];
    EmissiveGeom emissive_geom = {static_cast<int>(k), -1, 0, 0, {}, false, -1};
    emissive_geom.uniform = surface.texture < 0 && surface.emissive_map < 0;
    if (emissive_geom.uniform) emissive_geom.axis = axis_of(shape, size);
    double area = area_of(shape, size);
    double power_area = area;
    if (shape == MESH || shape == HFIELD) {
      emissive_geom.mesh = scene.geom_mesh[g];
      emissive_geom.cumulative = triangle_shares(scene.meshes[emissive_geom.mesh]->bvh, area);
      power_area = area;
    } else if (shape == ELLIPSOID) {
      power_area = area * std::cbrt(std::pow(size[0] * size[1] * size[2], 2.0));
    }
    emissive_geom.area = static_cast<float>(area);
    emissive_geom.power = radiance * power_area;
    if (emissive_geom.power > 0 && std::isfinite(emissive_geom.power) && emissive_geom.area > 0)
      emissive_geoms_.push_back(emissive_geom);
  }
  emitter_of_geom_.resize(order.size());
  update_probabilities();
  make_environment(appearance);
}

// Assign selection probabilities by power, in order of the geoms.
void Emitters::update_probabilities() {
  std::fill(emitter_of_geom_.begin(), emitter_of_geom_.end(), -1);
  emitters_.clear();
  double total = 0, sum = 0;
  for (const EmissiveGeom& g : emissive_geoms_) total += g.power;
  for (const EmissiveGeom& g : emissive_geoms_) {
    float begin = static_cast<float>(sum / total);
    sum += g.power;
    float end = static_cast<float>(sum / total);
    emitter_of_geom_[g.geom] = static_cast<int>(emitters_.size());
    emitters_.push_back({g.geom, begin, end, g.area,
                         g.cumulative.empty() ? nullptr : g.cumulative.data(),
                         static_cast<int>(g.cumulative.size()), g.uniform, g.axis});
  }
}

void Emitters::forget_mesh(int mesh) {
  remove_emitters([mesh](const EmissiveGeom& g) { return g.mesh == mesh; });
}

bool Emitters::forget_geom(int geom) {
  return remove_emitters([geom](const EmissiveGeom& g) { return g.geom == geom; });
}

template <class Which>
bool Emitters::remove_emitters(Which which) {
  auto end = std::remove_if(emissive_geoms_.begin(), emissive_geoms_.end(), which);
  if (end == emissive_geoms_.end()) return false;
  emissive_geoms_.erase(end, emissive_geoms_.end());
  update_probabilities();
  return true;
}

// Build the distribution of a skybox that shines and of image lights together, unless their light
// is so even that rays that leave a surface find it as well.
void Emitters::make_environment(const Appearance& appearance) {
  struct Source {
    const Texture* texture;
    int level;
    float tint[3];
  };
  std::vector<Source> sources;
  auto add = [&](int texture, const float* tint) {
    const Texture& t = appearance.textures[texture];
    int level = 0;
    while (level + 1 < t.levels && t.level[level].width > 32) level++;
    sources.push_back({&t, level, {tint[0], tint[1], tint[2]}});
  };
  constexpr float WHITE[3] = {1, 1, 1};
  if (appearance.sky_shines) add(appearance.skybox, WHITE);
  for (const Light& light : appearance.lights) {
    if (light.is_image()) add(light.texture, light.diffuse);
  }
  int n = 0;
  for (const Source& s : sources) n = std::max(n, s.texture->level[s.level].width);
  if (n == 0) return;
  size_t rows = 6 * static_cast<size_t>(n), count = rows * n;
  std::vector<double> weights(count);
  double total = 0, sphere = 0, brightest = 0;
  for (size_t i = 0; i < count; i++) {
    int face = static_cast<int>(i) / (n * n), row = static_cast<int>(i) / n % n;
    int column = static_cast<int>(i) % n;
    double x = (column + 0.5) / n * 2 - 1, y = (row + 0.5) / n * 2 - 1, light = 0;
    for (const Source& s : sources) {
      int side = s.texture->level[s.level].width;
      int y_at = row * side / n + 1, x_at = column * side / n + 1;
      for (int c = 0; c < 3; c++) {
        light +=
            WEIGHTS[c] * s.tint[c] * s.texture->texels[s.texture->at(c, s.level, face, y_at, x_at)];
      }
    }
    double solid_angle = std::pow(1 + x * x + y * y, -1.5);
    weights[i] = light * solid_angle;
    total += weights[i];
    sphere += solid_angle;
    brightest = std::max(brightest, light);
  }
  if (!(total > 0) || !std::isfinite(total) || brightest * sphere < PEAK * total) return;
  // no cell has probability 0: its neighbours' light is interpolated into it
  double mean = total / static_cast<double>(count), sum = 0;
  for (double& w : weights) w += 0.1 * mean;
  total *= 1.1;
  side_ = n;
  for (size_t r = 0; r < rows; r++) {
    double row = 0, part = 0;
    for (int i = 0; i < n; i++) row += weights[r * n + i];
    sum += row;
    rows_.push_back(static_cast<float>(sum / total));
    for (int i = 0; i < n; i++) {
      part += weights[r * n + i];
      cells_.push_back(static_cast<float>(part / row));
      pdf_.push_back(static_cast<float>(weights[r * n + i] / total * n * n * 0.25));
    }
    add_guide(cells_.data() + r * n, n, cell_guide_);
  }
  add_guide(rows_.data(), static_cast<int>(rows), row_guide_);
}

PathFrame Emitters::frame() const {
  PathFrame f = {};
  f.transparent = !transparent_geoms_.empty();
  f.emissive = emissive_;
  f.has_environment = has_environment_;
  f.lamp_count = lamp_count_;
  std::copy(ambient_radiance_, ambient_radiance_ + 3, f.ambient_radiance);
  f.environment_probability = side_ == 0 ? 0.0f : emitters_.empty() ? 1.0f : 0.5f;
  f.environment = {side_,       rows_.data(),      cells_.data(),
                   pdf_.data(), row_guide_.data(), cell_guide_.data()};
  f.emitters = emitters_.data();
  f.emitter_count = static_cast<int>(emitters_.size());
  f.emitter_of_geom = emitter_of_geom_.data();
  return f;
}

}  // namespace evs
