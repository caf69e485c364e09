// A bounding volume hierarchy over triangles, built once: binned surface area heuristic
// (Wald 2007), two children a node, at most six triangles a leaf.
#pragma once

#include <vector>

#include "scene.h"

namespace evs {

struct Tree {
  std::vector<Node> nodes;          // nodes[0] is the root; empty: no triangle
  std::vector<Triangle> triangles;  // in leaf order
  std::vector<int> order;           // order[i]: which input face triangles[i] was
  std::vector<int32_t> faces;       // vertices of each triangle, in leaf order
  V3 center = {0, 0, 0};            // of a ball around everything
  float radius = 0;
};

// In: vertices (nv, 3), faces (nf, 3). Degenerate triangles stay in; no ray hits them.
Tree build_tree(const float* vertices, int vertex_count, const int32_t* faces, int face_count);

// Triangles, boxes and ball at new vertices, as many as the tree was built with; its shape stays.
// Numbers that are not finite make triangles that nothing hits.
void fit(Tree& tree, const float* vertices, int vertex_count);

}  // namespace evs
