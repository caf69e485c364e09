// Feature flags: a caster enables the features that its scene needs, unless a test forces them.
#pragma once

#include <array>
#include <map>
#include <stdexcept>
#include <string>

namespace evs {

enum Feature {
  COLOUR = 0,      // three channels instead of luminance alone
  LOBES,           // GGX lobes: physical materials, maps
  NORMAL_MAPS,     // normal mapping
  TEXTURE_FILTER,  // anisotropic filtering along camera rays
  OUTLINES,        // outlines of shapes cover parts of what samples stand for
  FOG,
  HAZE,
  SHADOWS,        // shadow rays
  PLANE_SHADOWS,  // planes occlude lights that are on their front
  FULL_RETRACE,   // ignore what nothing that moved can affect
  REFITS,         // refit the BVHs of deforming meshes
  EMISSIVE,       // paths look for emissive surfaces after their last bounce
  TRANSPARENT,    // paths evaluate the opacity of each layer
  HIERARCHY,      // find what rays may touch through a hierarchy over geoms
  LIGHT_REACH,    // leave out lights where they cannot reach
  CACHED_LIGHT,   // `hybrid` adds the diffuse light of sky and bounces
  FEATURE_COUNT
};

constexpr const char* FEATURE_NAMES[FEATURE_COUNT] = {
    "colour",      "physical_gloss", "normal_maps",   "texture_filter", "outlines", "fog",
    "haze",        "shadows",        "plane_shadows", "full_retrace",   "refits",   "glowing",
    "transparent", "hierarchy",      "light_reach",   "cached_light"};

using FeatureFlags = std::map<std::string, bool>;

// Features forced on (the output's bytes stay the same, but for TRANSPARENT, and for HIERARCHY with
// `hybrid`) or off (for tests: what needs the feature is then wrong, or with HIERARCHY and
// LIGHT_REACH slow).
class ForcedFeatures {
 public:
  ForcedFeatures() { setting_.fill(-1); }

  // Throws std::invalid_argument for an unknown name.
  explicit ForcedFeatures(const FeatureFlags& flags) : ForcedFeatures() {
    for (const auto& [name, on] : flags) {
      int feature = 0;
      while (feature < FEATURE_COUNT && name != FEATURE_NAMES[feature]) feature++;
      if (feature == FEATURE_COUNT) throw std::invalid_argument("no feature is called " + name);
      setting_[feature] = on;
    }
  }

  bool on(Feature feature) const { return setting_[feature] == 1; }
  bool off(Feature feature) const { return setting_[feature] == 0; }
  bool decide(Feature feature, bool needed) const {
    return setting_[feature] < 0 ? needed : setting_[feature] == 1;
  }

 private:
  std::array<int, FEATURE_COUNT> setting_;
};

// Add fog or haze that is fully transparent, to a caster that must have it. An environment, which
// fog hides, is black behind it.
struct Medium;
void add_clear_fog(Medium& medium);
void add_clear_haze(Medium& medium);

}  // namespace evs
