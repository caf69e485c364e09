#include "render/seed_cycle.h"

#include <algorithm>

namespace evs {
namespace {

// How far the squared change may exceed the variance of the sets before their mean gives way.
// Chosen on six scenes, still and panned (lab/docs/sampling.md).
constexpr float CHANGE = 4.0f;
// Added to both, so that 0 by 0 is 1; far below any light, squared.
constexpr float LEAST = 1e-24f;

constexpr size_t BLOCK = 512;

}  // namespace

void combine_cycle(const float* planes, const float* before, int sets, int newest, size_t count,
                   float* light) {
  const float share = 1.0f / static_cast<float>(sets);
  const float free = 1.0f / static_cast<float>(sets - 1);
  // the variance that a step between two halves of the sets leaves, for a step of 1
  const float step = 0.25f * static_cast<float>(sets) * free;
  // the middle of the cycle: (sets - 1) / 2 ticks ago, between two ticks if that is no whole number
  const float* later =
      planes + static_cast<size_t>((newest + sets - (sets - 1) / 2) % sets) * count;
  const float* earlier = planes + static_cast<size_t>((newest + sets - sets / 2) % sets) * count;
  const float* now = planes + static_cast<size_t>(newest) * count;
  for (size_t begin = 0; begin < count; begin += BLOCK) {
    const size_t size = std::min(BLOCK, count - begin);
    float mean[BLOCK], variance[BLOCK];
    // always in the order of the sets, so that still light keeps its bits
    std::copy_n(planes + begin, size, mean);
    for (int s = 1; s < sets; s++) {
      const float* plane = planes + static_cast<size_t>(s) * count + begin;
      for (size_t i = 0; i < size; i++) mean[i] += plane[i];
    }
    for (size_t i = 0; i < size; i++) mean[i] *= share, variance[i] = 0;
    for (int s = 0; s < sets; s++) {
      const float* plane = planes + static_cast<size_t>(s) * count + begin;
      for (size_t i = 0; i < size; i++) {
        const float off = plane[i] - mean[i];
        variance[i] += off * off;
      }
    }
    for (size_t i = 0; i < size; i++) {
      const float difference = now[begin + i] - before[begin + i];
      const float change = difference * difference;
      const float noise = std::max(variance[i] * free - step * change, 0.0f) * CHANGE + LEAST;
      const float weight = noise / (noise + change);
      const float middle = 0.5f * (later[begin + i] + earlier[begin + i]);
      light[begin + i] = mean[i] + (1.0f - weight) * (middle - mean[i]);
    }
  }
}

}  // namespace evs
