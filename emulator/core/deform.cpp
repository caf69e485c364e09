#include "deform.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

struct Box {
  float low[3] = {1e30f, 1e30f, 1e30f}, high[3] = {-1e30f, -1e30f, -1e30f};

  // a NaN leaves the box as it is
  void add(V3 v) {
    const float at[3] = {v.x, v.y, v.z};
    for (int a = 0; a < 3; a++) {
      low[a] = std::min(low[a], at[a]);
      high[a] = std::max(high[a], at[a]);
    }
  }
};

// The ball around all vertices, as build_tree has it.
void fit_ball(Tree& tree, const float* vertices, int vertex_count) {
  auto vertex = [&](int i) {
    return V3{vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]};
  };
  Box all;
  for (int i = 0; i < vertex_count; i++) all.add(vertex(i));
  tree.center = {0.5f * (all.low[0] + all.high[0]), 0.5f * (all.low[1] + all.high[1]),
                 0.5f * (all.low[2] + all.high[2])};
  tree.radius = 0;
  for (int i = 0; i < vertex_count; i++) {
    V3 v = vertex(i);
    float x = v.x - tree.center.x, y = v.y - tree.center.y, z = v.z - tree.center.z;
    tree.radius = std::max(tree.radius, std::sqrt(x * x + y * y + z * z));
  }
}

// A child's node always comes after its parent's: from the last to the first, all boxes are known.
void fit_boxes(Tree& tree) {
  float margin = BOX_MARGIN * tree.radius;
  for (size_t n = tree.nodes.size(); n-- > 0;) {
    Node& node = tree.nodes[n];
    for (int c = 0; c < 2; c++) {
      Box box;
      if (node.child[c] >= 0) {
        const Node& below = tree.nodes[node.child[c]];
        for (int k = 0; k < 2; k++) {
          for (int a = 0; a < 3; a++) {
            box.low[a] = std::min(box.low[a], below.low[k][a]);
            box.high[a] = std::max(box.high[a], below.high[k][a]);
          }
        }
      } else {
        for (int i = ~node.child[c], end = i + node.count[c]; i < end; i++) {
          const Triangle& t = tree.triangles[i];
          for (V3 v : {t.a, t.b, t.c}) box.add(v);
        }
        for (int a = 0; a < 3; a++) {
          box.low[a] -= margin;
          box.high[a] += margin;
        }
      }
      std::copy(box.low, box.low + 3, node.low[c]);
      std::copy(box.high, box.high + 3, node.high[c]);
    }
  }
}

}  // namespace

void deform(SceneData::MeshData& mesh, const float* vertices, const float* normals) {
  auto row = [](const float* rows, int i) {
    return V3{rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]};
  };
  for (size_t i = 0; i < mesh.tree.triangles.size(); i++) {
    const int32_t* face = &mesh.faces[3 * i];
    mesh.tree.triangles[i] =
        make_triangle(row(vertices, face[0]), row(vertices, face[1]), row(vertices, face[2]));
    for (int k = 0; k < 3; k++) mesh.corners[i].normal[k] = row(normals, face[k]);
  }
  fit_ball(mesh.tree, vertices, mesh.vertex_count);
  fit_boxes(mesh.tree);
}

}  // namespace evs
