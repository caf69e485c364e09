// The constant part of a scene, before it is prepared for the kernels.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "scene/bvh.h"
#include "scene/light.h"

namespace evs {

// The constant part of a scene, as Python passes it. Colours are coded as in MuJoCo.
struct SceneData {
  struct MeshData {
    Bvh bvh;
    std::vector<Corners> corners;
    bool has_texcoords;
    int vertex_count;
  };
  struct TextureData {
    std::vector<uint8_t> data;
    int faces, height, width, components;
    bool srgb;
    int like = -1;  // the same image in the previous scene, -1 none
  };
  struct SurfaceData {
    float rgba[4];
    int texture;
    float repeat[2];
    bool uniform;
    float emission, specular, shininess, reflectance;
    float metallic = -1, roughness = -1;  // negative: a classic material, unless it has such a map
    // textures, -1 none; the first four have one component
    int metallic_map = -1, roughness_map = -1, occlusion_map = -1, opacity_map = -1;
    int normal_map = -1, emissive_map = -1;
  };
  struct MediumData {
    bool fog = false, haze = false;
    float fog_start = 0, fog_end = 0, fog_color[3] = {};
    float haze_ratio = 0, haze_radius = 0, haze_color[3] = {};
  };
  std::vector<int> geom_type, geom_mesh, geom_surface;
  std::vector<float> geom_size;                   // (ng, 3)
  std::vector<std::shared_ptr<MeshData>> meshes;  // copied before one is deformed
  std::vector<TextureData> textures;
  std::vector<SurfaceData> surfaces;
  std::vector<LightData> lights;
  int skybox = -1;
  bool sky_shines = false;  // else the skybox is a backdrop
  MediumData medium;
};

// In: vertices (nv, 3) finite, faces (nf, 3) in range, normals (nf, 3, 3) and texcoords (nf, 3, 2)
// or null. Without normals the faces' own are used. Throws std::invalid_argument for invalid
// numbers.
SceneData::MeshData make_mesh(const float* vertices, int vertex_count, const int32_t* faces,
                              int face_count, const float* normals, const float* texcoords);

// Deform a mesh: vertices and unit normals (nv, 3), as many as it was made with.
void deform(SceneData::MeshData& mesh, const float* vertices, const float* normals);

}  // namespace evs
