#include "base/isa.h"

#include <stdexcept>

namespace evs {

std::vector<std::string> isa_available() {
  std::vector<std::string> names;
  // in builds for tests only, which are to take it
  if (EVS_BUILT_ONE_LANE) names.push_back("one_lane");
#if EVS_X86
  __builtin_cpu_init();
  if (EVS_BUILT_AVX512 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    names.push_back("avx512");
  }
  if (EVS_BUILT_AVX2 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    names.push_back("avx2");
  }
#endif
  if (EVS_BUILT_NEON) names.push_back("neon");  // every 64-bit ARM processor has it
  if (EVS_BUILT_PORTABLE) names.push_back("portable");
  if (names.empty()) {
    throw std::runtime_error(
        "this core was built for another processor only, as `make demo` does: run `make test`");
  }
  return names;
}

}  // namespace evs
