// Meshes whose vertices move: the tree keeps its shape, its boxes are fitted anew.
#pragma once

#include "scene_data.h"

namespace evs {

// In: vertices and unit normals (nv, 3), as many as the mesh was made with. Costs one pass over
// triangles and nodes. Numbers that are not finite make triangles that nothing hits.
void deform(SceneData::MeshData& mesh, const float* vertices, const float* normals);

}  // namespace evs
