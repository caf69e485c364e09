// The irradiance of an image light as a smooth function of the normal.
#pragma once

#include "mipmap.h"

namespace evs {

// Project an environment's irradiance over pi on spherical harmonics up to order 2: mean error
// about 1 % (Ramamoorthi and Hanrahan 2001), 0 for a uniform environment. In: image (6 faces),
// linear light. Out: coefficients (9) of channel `channel`, in the order of Light::harmonics, in
// the world's frame.
void project_irradiance(const MipChain& image, int channel, float* factors);

}  // namespace evs
