// One register of floats, in which convolutions add up; on a GPU one float of a thread.
#pragma once

#include "base/simd.inl"
#include "evsnet/network_kernel.h"

namespace evs::EVS_NAMESPACE {
namespace {

// Float may be several registers, and compilers keep sums of those in memory.
#if EVS_VECTOR_BITS == 512
using Wide = __m512;
EVS_INLINE Wide wide(float a) { return _mm512_set1_ps(a); }
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) { return _mm512_fmadd_ps(a, b, c); }
// ReLU, clamped to the largest float: never -0, NaN or Inf
EVS_INLINE Wide wide_relu(Wide a) {
  return _mm512_min_ps(_mm512_max_ps(a, wide(0.0f)), wide(LARGEST));
}
// register block: outputs times ticks, or more outputs where few ticks are left
constexpr int OUTPUTS = 4, TICKS = 4, OUTPUTS_ALONE = 8;
#elif EVS_VECTOR_BITS == 32
using Wide = float;
constexpr int OUTPUTS = 4, TICKS = 2, OUTPUTS_ALONE = 8;
EVS_INLINE Wide wide(float a) { return a; }
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) { return __builtin_fmaf(a, b, c); }
EVS_INLINE Wide wide_relu(Wide a) {
  a = a > 0.0f ? a : 0.0f;
  return a < LARGEST ? a : LARGEST;
}
#else
using Wide = FloatPart;
// NEON has twice the registers of AVX2
constexpr int OUTPUTS = 4, TICKS = EVS_NEON ? 4 : 2, OUTPUTS_ALONE = 8;
EVS_INLINE Wide wide(float a) { return a - Wide{}; }
#if EVS_VECTOR_BITS == 256
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) { return _mm256_fmadd_ps(a, b, c); }
#elif EVS_NEON
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) {
  return (Wide)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
}
#else
// slow where there is no such instruction: a function call for each lane
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) {
#pragma GCC unroll 4
  for (int i = 0; i < PART; i++) c[i] = __builtin_fmaf(a[i], b[i], c[i]);
  return c;
}
#endif
EVS_INLINE Wide wide_relu(Wide a) {
  a = a > wide(0.0f) ? a : wide(0.0f);
  return a < wide(LARGEST) ? a : wide(LARGEST);
}
#endif

constexpr int WIDE = EVS_VECTOR_BITS / 32;  // lanes of a register

EVS_INLINE Wide wide_load(const float* p) {
  Wide a;
  __builtin_memcpy(&a, p, sizeof a);
  return a;
}
EVS_INLINE void wide_store(float* p, Wide a) { __builtin_memcpy(p, &a, sizeof a); }

}  // namespace
}  // namespace evs::EVS_NAMESPACE
