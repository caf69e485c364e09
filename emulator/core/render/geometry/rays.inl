// A packet of rays, and what they hit.
#pragma once

#include "simd/vec.inl"

namespace evs::EVS_NAMESPACE {
namespace {

struct Rays {
  Vec origin;            // camera frame; all zero where `common`
  Vec direction;         // unit
  bool common;           // all rays start at the camera, so Geom::camera is their local origin
  bool primary = false;  // camera rays
};

struct Hit {
  Float distance;
  Int geom;      // -1: none
  Int triangle;  // of a mesh
  Float u, v;    // barycentric
};

constexpr float T_INFINITY = 1e30f;

}  // namespace
}  // namespace evs::EVS_NAMESPACE
