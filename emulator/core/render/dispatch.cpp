// Which kernels can run here.

#include <stdexcept>

#include "base/isa.h"
#include "render/caster.h"

namespace evs {

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
#if EVS_BUILT_NEON
  if (wanted == "neon") return &KERNEL_NEON;
#endif
#if EVS_BUILT_PORTABLE
  if (wanted == "portable") return &KERNEL_PORTABLE;
#endif
#if EVS_BUILT_ONE_LANE
  if (wanted == "one_lane") return &KERNEL_ONE_LANE;
#endif
  throw std::logic_error("no kernel for instruction set '" + wanted + "'");
}

}  // namespace evs
