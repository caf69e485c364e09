// Bounding spheres and capsules of geoms. A capsule fits a long geom more closely than a sphere
// does.
#pragma once

#include "scene/path_scene.h"

namespace evs {

// Return the smaller of a geom's bounding sphere and a capsule along its longest axis. `bit` is not
// set.
BoundingCapsule bounding_capsule(const Geom& geom, const BoundingSphere& sphere);

}  // namespace evs
