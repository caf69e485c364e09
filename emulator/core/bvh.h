// A bounding volume hierarchy over triangles, built once: binned surface area heuristic
// (Wald 2007), two children a node, at most four triangles a leaf.
#pragma once

#include <vector>

#include "scene.h"

namespace evs {

struct Tree {
  std::vector<Node> nodes;          // nodes[0] is the root; empty: no triangle
  std::vector<Triangle> triangles;  // in leaf order
  std::vector<int> order;           // order[i]: which input face triangles[i] was
  V3 center = {0, 0, 0};            // of a ball around everything
  float radius = 0;
};

// Boxes are larger than their triangles by this share of the radius: what a hit on a rim may be
// off.
constexpr float BOX_MARGIN = 2e-6f;

Triangle make_triangle(V3 a, V3 b, V3 c);

// In: vertices (nv, 3), faces (nf, 3). Degenerate triangles stay in; no ray hits them.
Tree build_tree(const float* vertices, int vertex_count, const int32_t* faces, int face_count);

}  // namespace evs
