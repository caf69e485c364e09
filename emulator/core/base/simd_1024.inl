// Thirty-two lanes: two 512-bit registers side by side, so that one half computes while the other
// waits for memory. Part of simd.inl, for EVS_WIDTH 1024.
#pragma once

#include "simd_target.h"

constexpr int LANES = 32;
constexpr unsigned ALL_LANES = 0xffffffffu;

struct Mask {
  __mmask16 m[2];
};
struct Float {
  __m512 v[2];
};
struct Int {
  __m512i v[2];
};

#define EVS_1(R, FIELD, NAME, T, CALL)             \
  EVS_INLINE R NAME(T a) {                         \
    R r;                                           \
    for (int i = 0; i < 2; i++) r.FIELD[i] = CALL; \
    return r;                                      \
  }
#define EVS_2(R, FIELD, NAME, T, CALL)             \
  EVS_INLINE R NAME(T a, T b) {                    \
    R r;                                           \
    for (int i = 0; i < 2; i++) r.FIELD[i] = CALL; \
    return r;                                      \
  }

EVS_1(Float, v, splat, float, _mm512_set1_ps(a))
EVS_1(Int, v, splat, int, _mm512_set1_epi32(a))
EVS_1(Float, v, load, const float*, _mm512_loadu_ps(a + 16 * i))
EVS_1(Int, v, load, const int*, _mm512_loadu_si512(a + 16 * i))
EVS_INLINE void store(float* p, Float a) {
  for (int i = 0; i < 2; i++) _mm512_storeu_ps(p + 16 * i, a.v[i]);
}
EVS_INLINE void store(int* p, Int a) {
  for (int i = 0; i < 2; i++) _mm512_storeu_si512(p + 16 * i, a.v[i]);
}

EVS_2(Float, v, operator+, Float, _mm512_add_ps(a.v[i], b.v[i]))
EVS_2(Float, v, operator-, Float, _mm512_sub_ps(a.v[i], b.v[i]))
EVS_2(Float, v, operator*, Float, _mm512_mul_ps(a.v[i], b.v[i]))
EVS_2(Float, v, operator/, Float, _mm512_div_ps(a.v[i], b.v[i]))
EVS_1(Float, v, sqrt, Float, _mm512_sqrt_ps(a.v[i]))
EVS_2(Float, v, min, Float, _mm512_min_ps(a.v[i], b.v[i]))
EVS_2(Float, v, max, Float, _mm512_max_ps(a.v[i], b.v[i]))
EVS_1(Float, v, abs, Float, _mm512_abs_ps(a.v[i]))
EVS_2(Mask, m, operator<, Float, _mm512_cmp_ps_mask(a.v[i], b.v[i], _CMP_LT_OQ))
EVS_2(Mask, m, operator<=, Float, _mm512_cmp_ps_mask(a.v[i], b.v[i], _CMP_LE_OQ))
EVS_2(Mask, m, operator==, Int, _mm512_cmpeq_epi32_mask(a.v[i], b.v[i]))
EVS_2(Mask, m, operator<, Int, _mm512_cmplt_epi32_mask(a.v[i], b.v[i]))
EVS_2(Int, v, operator+, Int, _mm512_add_epi32(a.v[i], b.v[i]))
EVS_2(Int, v, operator-, Int, _mm512_sub_epi32(a.v[i], b.v[i]))
EVS_2(Int, v, operator*, Int, _mm512_mullo_epi32(a.v[i], b.v[i]))
EVS_2(Int, v, operator&, Int, _mm512_and_si512(a.v[i], b.v[i]))
EVS_2(Int, v, operator|, Int, _mm512_or_si512(a.v[i], b.v[i]))
EVS_2(Int, v, operator^, Int, _mm512_xor_si512(a.v[i], b.v[i]))
template <int N>
EVS_1(Int, v, shift_right, Int, _mm512_srai_epi32(a.v[i], N))
EVS_1(Int, v, truncate, Float, _mm512_cvttps_epi32(a.v[i]))
    EVS_1(Float, v, to_float, Int, _mm512_cvtepi32_ps(a.v[i]))
        EVS_1(Int, v, as_int, Float, _mm512_castps_si512(a.v[i]))
            EVS_1(Float, v, as_float, Int, _mm512_castsi512_ps(a.v[i]))

                EVS_2(Mask, m, operator&, Mask, static_cast<__mmask16>(a.m[i] & b.m[i]))
                    EVS_2(Mask, m, operator|, Mask, static_cast<__mmask16>(a.m[i] | b.m[i]))
                        EVS_1(Mask, m, operator~, Mask, static_cast<__mmask16>(~a.m[i])) EVS_INLINE
    unsigned bits(Mask a) {
  return a.m[0] | static_cast<unsigned>(a.m[1]) << 16;
}
EVS_1(Mask, m, mask_of, unsigned, static_cast<__mmask16>(a >> (16 * i)))
EVS_INLINE Float select(Mask m, Float a, Float b) {
  Float r;
  for (int i = 0; i < 2; i++) r.v[i] = _mm512_mask_blend_ps(m.m[i], b.v[i], a.v[i]);
  return r;
}
EVS_INLINE Int select(Mask m, Int a, Int b) {
  Int r;
  for (int i = 0; i < 2; i++) r.v[i] = _mm512_mask_blend_epi32(m.m[i], b.v[i], a.v[i]);
  return r;
}
EVS_INLINE Float gather(const float* base, Int at) {
  Float r;
  for (int i = 0; i < 2; i++) r.v[i] = _mm512_i32gather_ps(at.v[i], base, 4);
  return r;
}
EVS_INLINE void store_at(float* base, Int at, Float a, Mask m) {
  for (int i = 0; i < 2; i++) _mm512_mask_i32scatter_ps(base, m.m[i], at.v[i], a.v[i], 4);
}
EVS_INLINE void compress(float* p, Float a, Mask m) {
  for (int i = 0; i < 2; i++) {
    _mm512_storeu_ps(p, _mm512_maskz_compress_ps(m.m[i], a.v[i]));
    p += __builtin_popcount(m.m[i]);
  }
}
EVS_INLINE float lowest(Float a) { return _mm512_reduce_min_ps(_mm512_min_ps(a.v[0], a.v[1])); }
EVS_INLINE float highest(Float a) { return _mm512_reduce_max_ps(_mm512_max_ps(a.v[0], a.v[1])); }
#undef EVS_1
#undef EVS_2
