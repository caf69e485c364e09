// The pixel step compiled for each instruction set. All give the same bytes; only their speed
// differs.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "isa.h"
#include "pixel_block.h"

namespace evs {

using StepPixels = size_t (*)(const PixelStep&, size_t first, size_t last, std::vector<Crossing>&);

#if EVS_BUILT_PORTABLE
inline size_t step_portable(const PixelStep& step, size_t first, size_t last,
                            std::vector<Crossing>& out) {
  return step_pixels(step, first, last, out);
}
#endif

#if EVS_BUILT_AVX2
EVS_AVX2 inline size_t step_avx2(const PixelStep& step, size_t first, size_t last,
                                 std::vector<Crossing>& out) {
  return step_pixels(step, first, last, out);
}
#endif

#if EVS_BUILT_AVX512
EVS_AVX512 inline size_t step_avx512(const PixelStep& step, size_t first, size_t last,
                                     std::vector<Crossing>& out) {
  return step_pixels(step, first, last, out);
}
#endif

// The step of an instruction set; "auto" is the best that this machine runs. Throws
// std::invalid_argument for others.
inline StepPixels choose_step(const std::string& isa) {
  const std::vector<std::string> names = isa_available();
  const std::string wanted = isa == "auto" ? names.front() : isa;
  if (std::find(names.begin(), names.end(), wanted) == names.end()) {
    throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'; use auto");
  }
#if EVS_BUILT_AVX512
  if (wanted == "avx512") return step_avx512;
#endif
#if EVS_BUILT_AVX2
  if (wanted == "avx2") return step_avx2;
#endif
#if EVS_BUILT_PORTABLE
  if (wanted == "portable") return step_portable;
#endif
  throw std::logic_error("no pixels for instruction set '" + wanted + "'");
}

}  // namespace evs
