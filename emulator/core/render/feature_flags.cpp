#include "render/feature_flags.h"

#include <algorithm>
#include <limits>

#include "render/caster.h"

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

FeatureFlags Caster::features() const {
  bool casting = false, through_planes = false;
  uint32_t planes = frame_.plane_count < 32 ? (1u << frame_.plane_count) - 1 : ~0u;
  for (const Light& light : appearance_.lights) {
    casting = casting || light.castshadow;
    through_planes = through_planes || (light.castshadow && (planes & ~light.non_occluders) != 0);
  }
  casting = casting && frame_.shadows;
  bool path = emitters_.has_value();
  bool on[FEATURE_COUNT] = {};
  on[COLOUR] = frame_.channels >= 3;
  on[LOBES] = frame_.lobes;
  on[NORMAL_MAPS] = frame_.normal_mapped;
  on[TEXTURE_FILTER] = frame_.probes > 0;
  on[FOG] = frame_.medium.fog;
  on[HAZE] = frame_.medium.haze;
  on[SHADOWS] = casting;
  on[PLANE_SHADOWS] = casting && through_planes;
  on[FULL_RETRACE] = forced_.decide(FULL_RETRACE, !incremental_);
  on[REFITS] = forced_.decide(REFITS, work_.bvhs_refitted > 0);
  on[EMISSIVE] = path && paths_.emissive;
  on[TRANSPARENT] = path && paths_.transparent;
  on[HIERARCHY] = frame_.bvh.top > 0;
  on[LIGHT_REACH] = frame_.cull_lights;
  on[CACHED_LIGHT] = irradiance_ && !forced_.off(CACHED_LIGHT);
  FeatureFlags flags;
  for (int feature = 0; feature < FEATURE_COUNT; feature++) {
    flags[FEATURE_NAMES[feature]] = on[feature];
  }
  return flags;
}

}  // namespace evs
