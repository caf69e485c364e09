// A packet of rays, and what they hit.
#pragma once

#include "simd/vec.inl"

namespace evs::EVS_SPACE {
namespace {

struct Rays {
  Vec origin;     // camera frame; all zero where `common`
  Vec direction;  // unit
  bool common;    // every ray starts at the camera: the geoms' precomputed camera position holds
  bool primary = false;  // rays of the image's pixels
};

struct Hit {
  Float distance;
  Int geom;      // -1 none
  Int triangle;  // of a mesh
  Float u, v;    // barycentric
};

constexpr float FAR = 1e30f;

}  // namespace
}  // namespace evs::EVS_SPACE
