// An image in linear light and its smaller copies, each texel the exact area mean of what it
// covers.
#pragma once

#include <cstdint>
#include <vector>

#include "large_pages.h"
#include "scene.h"

namespace evs {

struct Chain {
  std::vector<float, LargePages<float>> texels;
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

// Numbers, not colours: the image's first component.
Chain build_number_chain(const uint8_t* data, int faces, int height, int width, int components,
                         bool srgb);

// Unit normals (x, y, z) of an image whose first three components code them as (n + 1) / 2. Means
// of them are shorter the further they point apart.
Chain build_normal_chain(const uint8_t* data, int faces, int height, int width, int components,
                         bool srgb);

float from_srgb(float coded);

}  // namespace evs
