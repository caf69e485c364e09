// Recognises tiled images: checkers, grids, one colour. render/shading/checkerboard.inl averages
// them.
#pragma once

#include <cstdint>
#include <functional>

#include "scene/scene.h"

namespace evs {

// Recognise a tiled image. In: data (height, width, components); texel(p, c), channel c of the
// texel at p. Out: `columns`, `rows` and `tile` of the texture, if the image is tiled.
void find_tiles(const uint8_t* data, int height, int width, int components,
                const std::function<float(const uint8_t*, int)>& texel, Texture& t);

}  // namespace evs
