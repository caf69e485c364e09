// Which code paths a caster has: those that its scene asks for, unless a test says otherwise.
#pragma once

#include <array>
#include <map>
#include <stdexcept>
#include <string>

namespace evs {

enum Feature {
  COLOUR = 0,      // three channels instead of luminance alone
  LOBES,           // GGX gloss: physical materials, maps
  NORMAL_MAPS,     // bent normals
  TEXTURE_FILTER,  // images are read along what a pixel covers of them
  FOG,
  HAZE,
  SHADOWS,        // shadow rays
  PLANE_SHADOWS,  // planes stand in the way of light that is on their front
  FULL_RETRACE,   // pixels that nothing that moved can touch
  REFITS,         // trees of deforming meshes that keep their shape
  GLOWING,        // paths look for surfaces with light of their own after their last bounce
  TRANSPARENT,    // paths ask each layer how much it lets pass
  FEATURE_COUNT
};

constexpr const char* FEATURE_NAMES[FEATURE_COUNT] = {
    "colour",  "physical_gloss", "normal_maps",  "texture_filter", "fog",     "haze",
    "shadows", "plane_shadows",  "full_retrace", "refits",         "glowing", "transparent"};

using FeatureFlags = std::map<std::string, bool>;

// What is forced on (but for TRANSPARENT its bytes stay the same) or off (for tests: what needs it
// then comes out wrong).
class Forced {
 public:
  Forced() { said_.fill(-1); }

  // Throws std::invalid_argument for a name that is none.
  explicit Forced(const FeatureFlags& flags) : Forced() {
    for (const auto& [name, on] : flags) {
      int feature = 0;
      while (feature < FEATURE_COUNT && name != FEATURE_NAMES[feature]) feature++;
      if (feature == FEATURE_COUNT) throw std::invalid_argument("no feature is called " + name);
      said_[feature] = on;
    }
  }

  bool on(Feature feature) const { return said_[feature] == 1; }
  bool off(Feature feature) const { return said_[feature] == 0; }
  bool decide(Feature feature, bool needed) const {
    return said_[feature] < 0 ? needed : said_[feature] == 1;
  }

 private:
  std::array<int, FEATURE_COUNT> said_;
};

// Air that can be looked through as if it were not there, for a caster that has to have fog or
// haze. A sky, which fog hides, is black behind it.
struct Air;
void add_clear_fog(Air& air);
void add_clear_haze(Air& air);

}  // namespace evs
