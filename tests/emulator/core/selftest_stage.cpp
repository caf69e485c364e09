#include "tests/emulator/core/selftest.h"

#include <cmath>
#include <cstdio>

namespace evs {

int failures = 0;

void check(bool holds, const char* what) {
  if (holds) return;
  std::printf("FAILED: %s\n", what);
  failures++;
}

namespace {

SceneData::TextureData texture(int faces, int height, int width, int components) {
  SceneData::TextureData t = {{}, faces, height, width, components, true};
  for (int i = 0; i < faces * height * width * components; i++) {
    t.data.push_back(static_cast<uint8_t>(i * 37));
  }
  return t;
}

}  // namespace

SceneData scene_of_everything(float tint) {
  SceneData s;
  s.textures = {texture(1, 7, 5, 3), texture(6, 3, 3, 4), texture(1, 1, 1, 1), texture(6, 1, 1, 3)};
  for (int t = -1; t < 3; t++) {
    s.surfaces.push_back({{0.8f, 0.5f, 0.3f, t == 1 ? 0.5f : 1},
                          t,
                          {3, 2},
                          t == 1,
                          0.01f,
                          0.5f,
                          0.4f,
                          t == 0 ? 0.4f : 0});
  }
  const float vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.5f, 0.5f, 0.5f};
  const int32_t faces[] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 4, 2, 3, 4, 3, 1, 4, 0, 0, 0, 1, 1, 2};
  std::vector<float> uv;
  for (int i = 0; i < 8 * 6; i++) uv.push_back(static_cast<float>(i % 7) * 0.3f);
  auto add_mesh = [&](int count, const float* texcoords) {
    s.meshes.push_back(std::make_shared<SceneData::MeshData>(
        make_mesh(vertices, 5, faces, count, nullptr, texcoords)));
  };
  add_mesh(8, uv.data());
  add_mesh(0, nullptr);
  for (int shape = PLANE; shape <= MESH; shape++) {
    s.geom_type.push_back(shape);
    s.geom_mesh.push_back(shape == MESH ? 0 : shape == HFIELD ? 1 : -1);
    s.geom_surface.push_back(shape % 4);
    for (float size : {0.3f, 0.2f, 0.25f}) s.geom_size.push_back(shape == PLANE ? 3 * size : size);
  }
  for (int kind = SPOT; kind <= POINT; kind++) {
    s.lights.push_back({{kind, true, {1, 0.1f, 0}, 3, 0.1f, -1},
                        {0.1f, 0.1f, 0.1f},
                        {0.5f, 0.5f, tint},
                        {0.2f, 0.2f, 0.2f},
                        40,
                        0,
                        kind == POINT ? 2.0f : 0.0f,
                        0,
                        false});
  }
  s.lights.push_back({{DIRECTIONAL, false, {1, 0, 0}, 0, 0, -1},
                      {0, 0, 0},
                      {0.2f, 0.2f, 0.2f},
                      {0, 0, 0},
                      45,
                      0,
                      0,
                      0,
                      true});
  s.skybox = 3;
  return s;
}

ForcedFeatures as_with_many() {
  return ForcedFeatures({{"hierarchy", true}, {"light_reach", true}});
}

Stage stage_of(const SceneData& s, std::mt19937& random, double scale) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  Stage stage;
  for (size_t g = 0; g < s.geom_type.size(); g++) {
    for (int a = 0; a < 3; a++) stage.geom_pos.push_back(uniform(random) * scale);
    double w = uniform(random), x = uniform(random), y = uniform(random), z = uniform(random);
    double n = std::sqrt(w * w + x * x + y * y + z * z);
    w /= n, x /= n, y /= n, z /= n;
    for (double m : {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                     2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}) {
      stage.geom_mat.push_back(m);
    }
  }
  for (size_t l = 0; l < s.lights.size(); l++) {
    for (double p : {uniform(random), uniform(random), 3.0}) stage.light_pos.push_back(p);
    for (double d : {0.6, 0.0, -0.8}) stage.light_dir.push_back(d);
  }
  return stage;
}

}  // namespace evs
