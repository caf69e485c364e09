// An image light as a smooth function of the normal.
#pragma once

#include "mipmap.h"

namespace evs {

// Irradiance over pi of an environment, projected on spherical harmonics up to order 2: a mean
// error near 1 % (Ramamoorthi and Hanrahan 2001), none for an even sky.
// In: image (6 faces), linear light. Out: factors (9) of channel `channel`, as Light::harmonics has
// them, in the world's frame.
void project_irradiance(const Chain& image, int channel, float* factors);

}  // namespace evs
