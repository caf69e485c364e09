// Shared by the host and the kernels of a GPU.
#pragma once

namespace evs {

// Mix the light of a pixel's one sample with that of all its samples, by the weight of the latter.
inline float blend(float base, float refined, float weight) {
  return weight < 1 ? base + weight * (refined - base) : refined;
}

}  // namespace evs
