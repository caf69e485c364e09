// Mip chains: an image in linear light and its smaller levels, each texel the exact area mean of
// what it covers.
#pragma once

#include <cstdint>
#include <vector>

#include "base/large_pages.h"
#include "scene/scene.h"

namespace evs {

struct MipChain {
  std::vector<float, LargePages<float>> texels;
  std::vector<uint32_t, LargePages<uint32_t>> words;
  std::vector<float> decoded;
  Texture layout = {};  // its pointers are set by view()

  Texture view() const {
    Texture t = layout;
    t.texels = texels.data();
    t.words = words.empty() ? nullptr : words.data();
    t.decoded = decoded.data();
    return t;
  }
};

// Build the chain of a colour image. In: data (faces, height, width, components) uint8; `srgb`:
// display-coded; `tint` (3): linear factors. channels 3: RGB; 1: BT.709 luminance of the tinted
// colour; 4: that, then RGB.
MipChain build_mip_chain(const uint8_t* data, int faces, int height, int width, int components,
                         bool srgb, const float* tint, int channels);

// Build the chain of numbers, not colours: the image's first component.
MipChain build_scalar_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb);

// Build the chain of unit normals (x, y, z), which the image codes as (n + 1) / 2. A mean is
// shorter the more its normals differ.
MipChain build_normal_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb);

float from_srgb(float coded);

}  // namespace evs
