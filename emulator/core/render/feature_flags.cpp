#include "render/feature_flags.h"

#include <algorithm>
#include <limits>

#include "scene/scene.h"

namespace evs {

// Fog that ends too far away to be seen.
void add_clear_fog(Medium& medium) {
  medium.fog = true;
  medium.fog_end = std::numeric_limits<float>::max();
  medium.fog_slope = 1;
  std::fill(medium.fog_color, medium.fog_color + MAX_CHANNELS, 0.0f);
}

// A haze cone that covers nothing: no direction points down, full height is at the horizon, and no
// plane reaches it.
void add_clear_haze(Medium& medium) {
  medium.haze = true;
  medium.haze_ratio = 0;
  medium.haze_radius = std::numeric_limits<float>::max();
  medium.haze_elevation = 1;
  medium.haze_peak = 0.5f;
  medium.haze_up = {0, 0, 0};
  std::fill(medium.haze_color, medium.haze_color + MAX_CHANNELS, 0.0f);
}

}  // namespace evs
