// The pixel step compiled once for each instruction set; the bytes are the same, only the speed
// differs. Target attributes, not compiler flags: no other inline function of the program may come
// out with instructions that the machine lacks.
#pragma once

#include <stdexcept>
#include <string>

#include "pixel.h"

#if defined(__x86_64__) && defined(__GNUC__)
#define EVS_X86 1
#endif

namespace evs {

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
#if EVS_X86
  const bool has_avx2 = __builtin_cpu_supports("avx2");
  const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  if (has_avx512 && (isa == "avx512" || isa == "auto")) return step_avx512<kind>;
  if (has_avx2 && (isa == "avx2" || isa == "auto")) return step_avx2<kind>;
#endif
  if (isa == "portable" || isa == "auto") return step_portable<kind>;
  throw std::invalid_argument("no instruction set '" + isa + "' here; use auto");
}

}  // namespace evs
