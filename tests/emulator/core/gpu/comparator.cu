// The exact comparators of the event pixel, a pixel a thread.
#include "base/gpu/prelude.h"

#include "sensor/comparator.h"

namespace evs {

extern "C" __global__ void comparator(Comparators* pixels, ShotCandidate* shots,
                                      unsigned shot_count, Crossing* out, unsigned room,
                                      unsigned* counts) {
  unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  Comparators pixel = pixels[i];
  std::vector<Crossing> crossings{out + static_cast<size_t>(i) * room, room};
  const std::vector<ShotCandidate> candidates{shots, shot_count, shot_count};
  pixel.run<true>(i % 64, candidates, crossings);
  counts[i] = static_cast<unsigned>(crossings.size());
  pixels[i] = pixel;
}

}  // namespace evs
