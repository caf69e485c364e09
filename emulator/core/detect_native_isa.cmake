# Out: EVS_NATIVE_ISA, the best instruction set of this machine: avx512, avx2, neon or portable.
# The conditions are those of base/isa.cpp.
set(question "
#include <cstdio>
int main() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports(\"avx512f\") && __builtin_cpu_supports(\"avx512bw\") &&
      __builtin_cpu_supports(\"avx512dq\") && __builtin_cpu_supports(\"avx512vl\")) {
    std::puts(\"avx512\");
  } else if (__builtin_cpu_supports(\"avx2\") && __builtin_cpu_supports(\"fma\")) {
    std::puts(\"avx2\");
  } else
#elif defined(__aarch64__)
  if (true) {
    std::puts(\"neon\");
  } else
#endif
    std::puts(\"portable\");
}
")
try_run(EVS_NATIVE_ISA_RAN EVS_NATIVE_ISA_BUILT
  SOURCE_FROM_VAR detect_native_isa.cpp question
  RUN_OUTPUT_STDOUT_VARIABLE answer)
# try_run runs once and is remembered, its output is not
if(answer)
  string(STRIP "${answer}" answer)
  set(EVS_NATIVE_ISA "${answer}" CACHE INTERNAL "this machine's best instruction set")
endif()
if(NOT EVS_NATIVE_ISA)
  message(FATAL_ERROR "cannot find out this machine's instruction set; build with EVS_ISA=all")
endif()
