// Which kernels can run here.

#include <stdexcept>

#include "caster.h"
#include "isa.h"

namespace evs {

std::vector<std::string> isa_available() {
  std::vector<std::string> names;
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
  if (EVS_BUILT_PORTABLE) names.push_back("portable");
  if (names.empty()) {
    throw std::runtime_error(
        "this core was built for another processor only, as `make demo` does: run `make test`");
  }
  return names;
}

const Kernel* kernel_of(const std::string& isa) {
  std::vector<std::string> names = isa_available();
  std::string wanted = isa == "auto" ? names.front() : isa;
  bool known = false;
  for (const std::string& name : names) known = known || name == wanted;
  if (!known) throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'");
#if EVS_BUILT_AVX512
  if (wanted == "avx512") return &KERNEL_AVX512;
#endif
#if EVS_BUILT_AVX2
  if (wanted == "avx2") return &KERNEL_AVX2;
#endif
#if EVS_BUILT_PORTABLE
  if (wanted == "portable") return &KERNEL_PORTABLE;
#endif
  throw std::logic_error("no kernel for instruction set '" + wanted + "'");
}

}  // namespace evs
