// A bounding volume hierarchy over triangles, built once and refitted: binned surface area
// heuristic (Wald 2007), two children per node, at most six triangles per leaf.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace evs {

struct Bvh {
  std::vector<Node> nodes;          // nodes[0] is the root; empty: no triangles
  std::vector<Triangle> triangles;  // in leaf order
  std::vector<int> order;           // order[i]: the input face of triangles[i]
  std::vector<int32_t> faces;       // vertices of each triangle, in leaf order
  V3 center = {0, 0, 0};            // of the bounding sphere
  float radius = 0;
};

// In: vertices (nv, 3), faces (nf, 3). Degenerate triangles are kept; no ray hits them.
Bvh build_bvh(const float* vertices, int vertex_count, const int32_t* faces, int face_count);

// Refit triangles, boxes and bounding sphere to new vertices, as many as before; the topology
// stays. Non-finite vertices make triangles that nothing hits.
void refit(Bvh& bvh, const float* vertices, int vertex_count);

}  // namespace evs
