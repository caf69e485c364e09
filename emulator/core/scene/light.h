// Lights, and all that depends on their kind: no other native file asks for it.
#pragma once

#include "base/simd_target.h"
#include "scene/scene.h"

namespace evs {

// Numbered as MuJoCo's mjtLightType.
enum LightKind { SPOT = 0, DIRECTIONAL, POINT, IMAGE, LIGHT_KINDS };

// What the kernels read as Python passes it, and the questions about the kind.
struct LightBase {
  int kind;
  bool castshadow;
  float attenuation[3];
  float exponent;
  float radius;  // of the bulb, m; `direct` uses points
  int texture;   // of an image light

  // Does it shine from everywhere around the scene, with a cube texture? It has no position, and no
  // shadow rays go to it.
  EVS_INLINE bool is_image() const { return kind == IMAGE; }
  // Are all its rays parallel? It has no position. Its ambient light is an even sky for `hybrid`
  // and `path`.
  EVS_INLINE bool is_delta_direction() const { return kind == DIRECTIONAL; }
  // Does it shine from a position?
  EVS_INLINE bool is_local() const { return !is_image() && !is_delta_direction(); }
  // Does it shine only within its cutoff?
  EVS_INLINE bool has_cone() const { return kind == SPOT; }
};

// The cone and the range of a light.
struct LightReach {
  float cosine, sine;  // -1, 0: everywhere
  float fade;          // 1 / range^2; 0: everywhere

  EVS_INLINE bool bounded() const { return cosine > -1 || fade > 0; }
};

// A light as Python passes it.
struct LightData : LightBase {
  float ambient[3], diffuse[3], specular[3];
  float cutoff_deg;
  float softness;
  float intensity;  // already divided by the lux of one unit; 0: diffuse holds
  float range;      // m
  bool headlight;

  // Visit each field by its name in Light of emulator/base/scene.py.
  template <class Visit>
  void each(Visit&& visit) {
    visit("kind", kind);
    visit("castshadow", castshadow);
    visit("attenuation", attenuation);
    visit("exponent", exponent);
    visit("bulbradius_m", radius);
    visit("texture", texture);
    visit("ambient", ambient);
    visit("diffuse", diffuse);
    visit("specular", specular);
    visit("cutoff_deg", cutoff_deg);
    visit("softness", softness);
    visit("intensity", intensity);
    visit("range_m", range);
    visit("headlight", headlight);
  }
};

// A light as the kernels read it.
struct Light : LightBase {
  V3 position, direction;  // camera frame; direction: unit, away from the light
  float ambient[MAX_CHANNELS], diffuse[MAX_CHANNELS], specular[MAX_CHANNELS];
  float cos_cutoff;
  bool inverse_square;  // physical intensity: 1 / r^2 instead of attenuation
  float fade;           // 1 / range^2: physical light ends at its range; 0: nowhere
  float edge;           // 1 / (cosine of the full cone - cos_cutoff), physical spots; 0: exponent
  // which of the first 32 geoms are planes with the light on their front, one bit each: they never
  // occlude it
  uint32_t non_occluders;
  // irradiance of an image light over pi, by the normal in the world's frame: coefficients of 1, y,
  // z, x, xy, yz, 3z^2 - 1, xz, x^2 - y^2
  float harmonics[MAX_CHANNELS][9];

  // Does it have a size? `direct` takes it for a point all the same.
  EVS_INLINE bool is_bulb() const { return radius > 0 && !is_delta_direction(); }

  EVS_INLINE LightReach reach() const {
    if (!is_local()) return {-1, 0, 0};
    float within = fade > 0 ? fade : 0;
    if (!has_cone()) return {-1, 0, within};
    // 2e-6 covers the rounding of the cosine that is compared with cos_cutoff
    float cosine = cos_cutoff - 2e-6f;
    cosine = cosine > -1.0f ? cosine : -1.0f;
    float square = 1.0f - cosine * cosine;
    return {cosine, __builtin_sqrtf(square > 0 ? square : 0), within};
  }
};

}  // namespace evs
