// A packet of rays, and what they hit.
#pragma once

#include "render/simd/vec.inl"

namespace evs::EVS_NAMESPACE {
namespace {

struct Rays {
  Vec origin;            // camera frame; all zero where `common`
  Vec direction;         // unit
  bool common;           // all rays start at the camera, so Geom::camera is their local origin
  bool primary = false;  // camera rays
  const Vec* mirror = nullptr;  // normals, where it is camera rays that a mirror has turned
};

struct Hit {
  static constexpr bool COVERS = false;
  Float distance;
  Int geom;      // -1: none
  Int triangle;  // of a mesh
  Float u, v;    // barycentric
};

constexpr float T_INFINITY = 1e30f;

// Hits whose distances differ by less, as a share of them, coincide. It is ten times the rounding
// that was measured between boxes, meshes, planes, lids and height fields from 0.6 to 50 m.
constexpr float COINCIDENT = 4e-6f;

}  // namespace
}  // namespace evs::EVS_NAMESPACE
