#include "scene/scene_data.h"

#include <cmath>
#include <stdexcept>

namespace evs {
namespace {

// Return corner normals and coordinates of face f, whose triangle is t.
Corners corners_of(const Triangle& t, size_t f, const float* normals, const float* texcoords) {
  V3 n = t.normal;
  float twice_area = std::sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
  float scale = twice_area > 0 ? 1.0f / twice_area : 1.0f;
  Corners c = {};
  for (size_t k = 0; k < 3; k++) {
    c.normal[k] = {n.x * scale, n.y * scale, n.z * scale};
    if (normals) {
      const float* p = normals + (3 * f + k) * 3;
      c.normal[k] = {p[0], p[1], p[2]};
    }
    if (texcoords) {
      const float* p = texcoords + (3 * f + k) * 2;
      c.uv[k][0] = p[0];
      c.uv[k][1] = p[1];
    }
  }
  float du1 = c.uv[1][0] - c.uv[0][0], dv1 = c.uv[1][1] - c.uv[0][1];
  float du2 = c.uv[2][0] - c.uv[0][0], dv2 = c.uv[2][1] - c.uv[0][1];
  c.uv_density = twice_area > 0 ? std::sqrt(std::abs(du1 * dv2 - du2 * dv1) / twice_area) : 0.0f;
  return c;
}

}  // namespace

SceneData::MeshData make_mesh(const float* vertices, int vertex_count, const int32_t* faces,
                              int face_count, const float* normals, const float* texcoords) {
  for (int i = 0; i < 3 * vertex_count; i++) {
    if (!std::isfinite(vertices[i])) throw std::invalid_argument("a mesh's vertex is not finite");
  }
  for (int i = 0; i < 3 * face_count; i++) {
    if (faces[i] < 0 || faces[i] >= vertex_count) {
      throw std::invalid_argument("a mesh's face names a vertex that does not exist");
    }
  }
  SceneData::MeshData mesh;
  mesh.bvh = build_bvh(vertices, vertex_count, faces, face_count);
  mesh.has_texcoords = texcoords != nullptr;
  mesh.vertex_count = vertex_count;
  for (size_t i = 0; i < mesh.bvh.order.size(); i++) {
    size_t f = static_cast<size_t>(mesh.bvh.order[i]);
    mesh.corners.push_back(corners_of(mesh.bvh.triangles[i], f, normals, texcoords));
  }
  return mesh;
}

void deform(SceneData::MeshData& mesh, const float* vertices, const float* normals) {
  refit(mesh.bvh, vertices, mesh.vertex_count);
  for (size_t i = 0; i < mesh.corners.size(); i++) {
    for (size_t k = 0; k < 3; k++) {
      const float* n = normals + 3 * mesh.bvh.faces[3 * i + k];
      mesh.corners[i].normal[k] = {n[0], n[1], n[2]};
    }
  }
}

}  // namespace evs
