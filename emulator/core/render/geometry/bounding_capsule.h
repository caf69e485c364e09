// Balls and capsules around geoms: what is long is thinner in a capsule than in a ball.
#pragma once

#include "path_scene.h"

namespace evs {

// The smaller of the ball around a geom and a capsule along its longest axis. No bit is set.
Rod rod_of(const Geom& geom, const Ball& ball);

}  // namespace evs
