// An image in linear light and its smaller copies, each texel the exact area mean of what it
// covers.
#pragma once

#include <cstdint>
#include <vector>

#include "scene.h"

namespace evs {

struct Chain {
  std::vector<float> texels;
  Texture layout = {};  // `texels` is set by view()

  Texture view() const {
    Texture t = layout;
    t.texels = texels.data();
    return t;
  }
};

// In: data (faces, height, width, components) uint8; `srgb`: display-coded. `tint` (3) linear
// factors. channels 3: RGB; 1: BT.709 luminance of the tinted colour; 4: that, then RGB.
Chain build_chain(const uint8_t* data, int faces, int height, int width, int components, bool srgb,
                  const float* tint, int channels);

// Numbers, not colours: `channels` of the image's components as they are, each its own channel.
Chain build_plain_chain(const uint8_t* data, int faces, int height, int width, int components,
                        bool srgb, int channels);

float from_srgb(float coded);

}  // namespace evs
