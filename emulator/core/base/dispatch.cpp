// Which kernels can run here.

#include <stdexcept>

#include "caster.h"

namespace evs {

std::vector<std::string> isa_available() {
  std::vector<std::string> names;
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    names.push_back("avx512");
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) names.push_back("avx2");
#endif
  names.push_back("portable");
  return names;
}

const Kernel* kernel_of(const std::string& isa) {
  std::vector<std::string> names = isa_available();
  std::string wanted = isa == "auto" ? names.front() : isa;
  bool known = false;
  for (const std::string& name : names) known = known || name == wanted;
  if (!known) throw std::invalid_argument("this machine cannot run instruction set '" + isa + "'");
#if defined(__x86_64__)
  if (wanted == "avx512") return &KERNEL_AVX512;
  if (wanted == "avx2") return &KERNEL_AVX2;
#endif
  return &KERNEL_PORTABLE;
}

}  // namespace evs
