// The pixel step compiled once for each instruction set; the bytes are the same, only the speed
// differs. Target attributes, not compiler flags: no other inline function of the program may come
// out with instructions that the machine lacks.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "pixel.h"

#if defined(__x86_64__) && defined(__GNUC__)
#define EVS_X86 1
#endif

namespace evs {

// Instruction sets that this machine runs, the best first (dispatch.cpp).
std::vector<std::string> isa_available();

using StepPixels = size_t (*)(const LogMap&, const PixelArrays&, size_t first, size_t last,
                              double tick, std::vector<Crossing>&);

template <LogKind kind>
size_t step_portable(const LogMap& map, const PixelArrays& pixels, size_t first, size_t last,
                     double tick, std::vector<Crossing>& out) {
  return step_pixels<kind>(map, pixels, first, last, tick, out);
}

#if EVS_X86
template <LogKind kind>
__attribute__((target("avx2"))) size_t step_avx2(const LogMap& map, const PixelArrays& pixels,
                                                 size_t first, size_t last, double tick,
                                                 std::vector<Crossing>& out) {
  return step_pixels<kind>(map, pixels, first, last, tick, out);
}

template <LogKind kind>
__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))) size_t
step_avx512(const LogMap& map, const PixelArrays& pixels, size_t first, size_t last, double tick,
            std::vector<Crossing>& out) {
  return step_pixels<kind>(map, pixels, first, last, tick, out);
}
#endif

// The best step of this machine ("auto"), or the one asked for: "avx512", "avx2" or "portable".
// Throws std::invalid_argument where the machine does not have it.
template <LogKind kind>
StepPixels choose_step(const std::string& isa) {
  const std::vector<std::string> names = isa_available();
  const std::string wanted = isa == "auto" ? names.front() : isa;
  if (std::find(names.begin(), names.end(), wanted) == names.end()) {
    throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'; use auto");
  }
#if EVS_X86
  if (wanted == "avx512") return step_avx512<kind>;
  if (wanted == "avx2") return step_avx2<kind>;
#endif
  return step_portable<kind>;
}

}  // namespace evs
