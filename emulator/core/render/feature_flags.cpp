#include "feature_flags.h"

#include <algorithm>
#include <limits>

#include "caster.h"

namespace evs {

// Its end is so far away that nothing is in it.
void add_clear_fog(Air& air) {
  air.fog = true;
  air.fog_end = std::numeric_limits<float>::max();
  air.fog_slope = 1;
  std::fill(air.fog_color, air.fog_color + MAX_CHANNELS, 0.0f);
}

// A cone that covers nothing: no direction goes down, its height is full at the horizon, and no
// plane reaches it.
void add_clear_haze(Air& air) {
  air.haze = true;
  air.haze_ratio = 0;
  air.haze_radius = std::numeric_limits<float>::max();
  air.haze_elevation = 1;
  air.haze_peak = 0.5f;
  air.haze_up = {0, 0, 0};
  std::fill(air.haze_color, air.haze_color + MAX_CHANNELS, 0.0f);
}

FeatureFlags Caster::features() const {
  bool casting = false, through_planes = false;
  uint32_t planes = frame_.plane_count < 32 ? (1u << frame_.plane_count) - 1 : ~0u;
  for (const Light& light : look_.lights) {
    casting = casting || light.castshadow;
    through_planes = through_planes || (light.castshadow && (planes & ~light.idle) != 0);
  }
  casting = casting && frame_.shadows;
  bool path = emitters_.has_value();
  bool on[FEATURE_COUNT] = {};
  on[COLOUR] = frame_.channels >= 3;
  on[LOBES] = frame_.lobes;
  on[NORMAL_MAPS] = frame_.bumpy;
  on[TEXTURE_FILTER] = frame_.probes > 0;
  on[FOG] = frame_.air.fog;
  on[HAZE] = frame_.air.haze;
  on[SHADOWS] = casting;
  on[PLANE_SHADOWS] = casting && through_planes;
  on[FULL_RETRACE] = forced_.decide(FULL_RETRACE, !incremental_);
  on[REFITS] = forced_.decide(REFITS, work_.trees_refitted > 0);
  on[GLOWING] = path && paths_.glowing;
  on[TRANSPARENT] = path && paths_.transparent;
  FeatureFlags flags;
  for (int feature = 0; feature < FEATURE_COUNT; feature++) {
    flags[FEATURE_NAMES[feature]] = on[feature];
  }
  return flags;
}

}  // namespace evs
