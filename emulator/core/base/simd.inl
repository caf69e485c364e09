// Vectors of float, int and mask: one source for all instruction sets, with the same bytes as
// result.
//
// A vector has 16 lanes (one register of 512 bits, two of 256 or four of 128), so control flow is
// the same too. With EVS_VECTOR_BITS 1024 it has 32 lanes in two registers of 512 bits: one half
// computes while the other waits for memory. With EVS_VECTOR_BITS 32 it has one lane.
//
// All operations are correctly rounded (+ - * / sqrt, comparison, truncation), nothing is
// contracted to fma, and no sum runs across lanes.
//
// min(a, b) is a < b ? a : b and max(a, b) is a > b ? a : b: with a NaN the second argument wins.
#pragma once

#include "base/simd_target.h"
#if EVS_VECTOR_BITS == 32
#include "base/simd_one_lane.inl"
#endif

namespace evs::EVS_NAMESPACE {
namespace {

#if EVS_VECTOR_BITS == 1024

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
EVS_1(Int, v, truncate, Float, _mm512_cvttps_epi32(a.v[i]))
EVS_1(Float, v, to_float, Int, _mm512_cvtepi32_ps(a.v[i]))
EVS_1(Int, v, as_int, Float, _mm512_castps_si512(a.v[i]))
EVS_1(Float, v, as_float, Int, _mm512_castsi512_ps(a.v[i]))
template <int N>
EVS_INLINE Int shift_right(Int a) {
  Int r;
  for (int i = 0; i < 2; i++) r.v[i] = _mm512_srai_epi32(a.v[i], N);
  return r;
}

EVS_2(Mask, m, operator&, Mask, static_cast<__mmask16>(a.m[i] & b.m[i]))
EVS_2(Mask, m, operator|, Mask, static_cast<__mmask16>(a.m[i] | b.m[i]))
EVS_1(Mask, m, operator~, Mask, static_cast<__mmask16>(~a.m[i]))
EVS_INLINE unsigned to_bits(Mask a) { return a.m[0] | static_cast<unsigned>(a.m[1]) << 16; }
EVS_1(Mask, m, mask_from_bits, unsigned, static_cast<__mmask16>(a >> (16 * i)))
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
EVS_INLINE void scatter(float* base, Int at, Float a, Mask m) {
  for (int i = 0; i < 2; i++) _mm512_mask_i32scatter_ps(base, m.m[i], at.v[i], a.v[i], 4);
}
EVS_INLINE void compress(float* p, Float a, Mask m) {
  for (int i = 0; i < 2; i++) {
    _mm512_storeu_ps(p, _mm512_maskz_compress_ps(m.m[i], a.v[i]));
    p += __builtin_popcount(m.m[i]);
  }
}
EVS_INLINE float reduce_min(Float a) { return _mm512_reduce_min_ps(_mm512_min_ps(a.v[0], a.v[1])); }
EVS_INLINE float reduce_max(Float a) { return _mm512_reduce_max_ps(_mm512_max_ps(a.v[0], a.v[1])); }
#undef EVS_1
#undef EVS_2

#elif EVS_VECTOR_BITS != 32

constexpr int LANES = 16;
constexpr unsigned ALL_LANES = 0xffffu;

#if EVS_VECTOR_BITS == 512

struct Mask {
  __mmask16 m;
};
struct Float {
  __m512 v;
};
struct Int {
  __m512i v;
};

EVS_INLINE Float splat(float a) { return {_mm512_set1_ps(a)}; }
EVS_INLINE Int splat(int a) { return {_mm512_set1_epi32(a)}; }
EVS_INLINE Float load(const float* p) { return {_mm512_loadu_ps(p)}; }
EVS_INLINE Int load(const int* p) { return {_mm512_loadu_si512(p)}; }
EVS_INLINE void store(float* p, Float a) { _mm512_storeu_ps(p, a.v); }
EVS_INLINE void store(int* p, Int a) { _mm512_storeu_si512(p, a.v); }

EVS_INLINE Float operator+(Float a, Float b) { return {_mm512_add_ps(a.v, b.v)}; }
EVS_INLINE Float operator-(Float a, Float b) { return {_mm512_sub_ps(a.v, b.v)}; }
EVS_INLINE Float operator*(Float a, Float b) { return {_mm512_mul_ps(a.v, b.v)}; }
EVS_INLINE Float operator/(Float a, Float b) { return {_mm512_div_ps(a.v, b.v)}; }
EVS_INLINE Float sqrt(Float a) { return {_mm512_sqrt_ps(a.v)}; }
EVS_INLINE Float min(Float a, Float b) { return {_mm512_min_ps(a.v, b.v)}; }
EVS_INLINE Float max(Float a, Float b) { return {_mm512_max_ps(a.v, b.v)}; }
EVS_INLINE Float abs(Float a) { return {_mm512_abs_ps(a.v)}; }
EVS_INLINE Mask operator<(Float a, Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ)}; }
EVS_INLINE Mask operator<=(Float a, Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ)}; }
EVS_INLINE Mask operator==(Int a, Int b) { return {_mm512_cmpeq_epi32_mask(a.v, b.v)}; }
EVS_INLINE Mask operator<(Int a, Int b) { return {_mm512_cmplt_epi32_mask(a.v, b.v)}; }
EVS_INLINE Int operator+(Int a, Int b) { return {_mm512_add_epi32(a.v, b.v)}; }
EVS_INLINE Int operator-(Int a, Int b) { return {_mm512_sub_epi32(a.v, b.v)}; }
EVS_INLINE Int operator*(Int a, Int b) { return {_mm512_mullo_epi32(a.v, b.v)}; }
EVS_INLINE Int operator&(Int a, Int b) { return {_mm512_and_si512(a.v, b.v)}; }
EVS_INLINE Int operator|(Int a, Int b) { return {_mm512_or_si512(a.v, b.v)}; }
EVS_INLINE Int operator^(Int a, Int b) { return {_mm512_xor_si512(a.v, b.v)}; }
template <int N>
EVS_INLINE Int shift_right(Int a) {
  return {_mm512_srai_epi32(a.v, N)};
}
EVS_INLINE Int truncate(Float a) { return {_mm512_cvttps_epi32(a.v)}; }
EVS_INLINE Float to_float(Int a) { return {_mm512_cvtepi32_ps(a.v)}; }
EVS_INLINE Int as_int(Float a) { return {_mm512_castps_si512(a.v)}; }
EVS_INLINE Float as_float(Int a) { return {_mm512_castsi512_ps(a.v)}; }

EVS_INLINE Mask operator&(Mask a, Mask b) { return {static_cast<__mmask16>(a.m & b.m)}; }
EVS_INLINE Mask operator|(Mask a, Mask b) { return {static_cast<__mmask16>(a.m | b.m)}; }
EVS_INLINE Mask operator~(Mask a) { return {static_cast<__mmask16>(~a.m)}; }
EVS_INLINE unsigned to_bits(Mask a) { return a.m; }
EVS_INLINE Mask mask_from_bits(unsigned lanes) { return {static_cast<__mmask16>(lanes)}; }
EVS_INLINE Float select(Mask m, Float a, Float b) { return {_mm512_mask_blend_ps(m.m, b.v, a.v)}; }
EVS_INLINE Int select(Mask m, Int a, Int b) { return {_mm512_mask_blend_epi32(m.m, b.v, a.v)}; }
EVS_INLINE Float gather(const float* base, Int at) { return {_mm512_i32gather_ps(at.v, base, 4)}; }
EVS_INLINE void scatter(float* base, Int at, Float a, Mask m) {
  _mm512_mask_i32scatter_ps(base, m.m, at.v, a.v, 4);
}
// Write the lanes of m side by side; what follows them, up to 16, has no meaning.
EVS_INLINE void compress(float* p, Float a, Mask m) {
  _mm512_storeu_ps(p, _mm512_maskz_compress_ps(m.m, a.v));
}
EVS_INLINE float reduce_min(Float a) { return _mm512_reduce_min_ps(a.v); }
EVS_INLINE float reduce_max(Float a) { return _mm512_reduce_max_ps(a.v); }

#else  // 256 or 128 bits: an array of native vectors

constexpr int PARTS = LANES * 32 / EVS_VECTOR_BITS;
constexpr int PART = LANES / PARTS;
typedef float FloatPart __attribute__((vector_size(EVS_VECTOR_BITS / 8)));
typedef int IntPart __attribute__((vector_size(EVS_VECTOR_BITS / 8)));
typedef unsigned UnsignedPart __attribute__((vector_size(EVS_VECTOR_BITS / 8)));  // may overflow

struct Mask {
  IntPart m[PARTS];  // each lane all ones or all zeros
};
struct Float {
  FloatPart v[PARTS];
};
struct Int {
  IntPart v[PARTS];
};

#define EVS_PARTS _Pragma("GCC unroll 4") for (int i = 0; i < PARTS; i++)
#define EVS_BINARY(T, R, FIELD, NAME, EXPRESSION) \
  EVS_INLINE R NAME(T a, T b) {                   \
    R r;                                          \
    EVS_PARTS r.FIELD[i] = EXPRESSION;            \
    return r;                                     \
  }

EVS_INLINE Float splat(float a) {
  Float r;
  EVS_PARTS r.v[i] = a - FloatPart{};
  return r;
}
EVS_INLINE Int splat(int a) {
  Int r;
  EVS_PARTS r.v[i] = a - IntPart{};
  return r;
}
EVS_INLINE Float load(const float* p) {
  Float r;
  __builtin_memcpy(&r, p, sizeof r);
  return r;
}
EVS_INLINE Int load(const int* p) {
  Int r;
  __builtin_memcpy(&r, p, sizeof r);
  return r;
}
EVS_INLINE void store(float* p, Float a) { __builtin_memcpy(p, &a, sizeof a); }
EVS_INLINE void store(int* p, Int a) { __builtin_memcpy(p, &a, sizeof a); }

EVS_BINARY(Float, Float, v, operator+, a.v[i] + b.v[i])
EVS_BINARY(Float, Float, v, operator-, a.v[i] - b.v[i])
EVS_BINARY(Float, Float, v, operator*, a.v[i] * b.v[i])
EVS_BINARY(Float, Float, v, operator/, a.v[i] / b.v[i])
EVS_BINARY(Float, Mask, m, operator<, (a.v[i] < b.v[i]))
EVS_BINARY(Float, Mask, m, operator<=, (a.v[i] <= b.v[i]))
EVS_BINARY(Int, Mask, m, operator==, (a.v[i] == b.v[i]))
EVS_BINARY(Int, Mask, m, operator<, (a.v[i] < b.v[i]))
EVS_BINARY(Int, Int, v, operator+, (IntPart)((UnsignedPart)a.v[i] + (UnsignedPart)b.v[i]))
EVS_BINARY(Int, Int, v, operator-, (IntPart)((UnsignedPart)a.v[i] - (UnsignedPart)b.v[i]))
EVS_BINARY(Int, Int, v, operator*, (IntPart)((UnsignedPart)a.v[i] * (UnsignedPart)b.v[i]))
EVS_BINARY(Int, Int, v, operator&, a.v[i] & b.v[i])
EVS_BINARY(Int, Int, v, operator|, a.v[i] | b.v[i])
EVS_BINARY(Int, Int, v, operator^, a.v[i] ^ b.v[i])
EVS_BINARY(Mask, Mask, m, operator&, a.m[i] & b.m[i])
EVS_BINARY(Mask, Mask, m, operator|, a.m[i] | b.m[i])

EVS_INLINE Mask operator~(Mask a) {
  EVS_PARTS a.m[i] = ~a.m[i];
  return a;
}
template <int N>
EVS_INLINE Int shift_right(Int a) {
  EVS_PARTS a.v[i] = a.v[i] >> N;
  return a;
}
EVS_INLINE Int truncate(Float a) {
  Int r;
  EVS_PARTS r.v[i] = __builtin_convertvector(a.v[i], IntPart);
  return r;
}
EVS_INLINE Float to_float(Int a) {
  Float r;
  EVS_PARTS r.v[i] = __builtin_convertvector(a.v[i], FloatPart);
  return r;
}
EVS_INLINE Int as_int(Float a) {
  Int r;
  __builtin_memcpy(&r, &a, sizeof r);
  return r;
}
EVS_INLINE Float as_float(Int a) {
  Float r;
  __builtin_memcpy(&r, &a, sizeof r);
  return r;
}
EVS_INLINE Float select(Mask m, Float a, Float b) {
  Float r;
#if EVS_VECTOR_BITS == 256
  EVS_PARTS r.v[i] = (FloatPart)_mm256_blendv_ps((__m256)b.v[i], (__m256)a.v[i], (__m256)m.m[i]);
#else
  EVS_PARTS r.v[i] = (FloatPart)((m.m[i] & (IntPart)a.v[i]) | (~m.m[i] & (IntPart)b.v[i]));
#endif
  return r;
}
EVS_INLINE Int select(Mask m, Int a, Int b) {
  Int r;
  EVS_PARTS r.v[i] = (m.m[i] & a.v[i]) | (~m.m[i] & b.v[i]);
  return r;
}
EVS_INLINE Float min(Float a, Float b) {
#if defined(__SSE2__)
  EVS_PARTS a.v[i] = EVS_INTRINSIC(min_ps)(a.v[i], b.v[i]);
  return a;
#else
  return select(a < b, a, b);
#endif
}
EVS_INLINE Float max(Float a, Float b) {
#if defined(__SSE2__)
  EVS_PARTS a.v[i] = EVS_INTRINSIC(max_ps)(a.v[i], b.v[i]);
  return a;
#else
  return select(b < a, a, b);
#endif
}
EVS_INLINE Float abs(Float a) {
#if EVS_NEON
  EVS_PARTS a.v[i] = (FloatPart)vabsq_f32((float32x4_t)a.v[i]);
#else
  EVS_PARTS a.v[i] = (FloatPart)((IntPart)a.v[i] & 0x7fffffff);
#endif
  return a;
}
EVS_INLINE Float sqrt(Float a) {
#if defined(__SSE2__)
  EVS_PARTS a.v[i] = EVS_INTRINSIC(sqrt_ps)(a.v[i]);
#elif EVS_NEON
  EVS_PARTS a.v[i] = (FloatPart)vsqrtq_f32((float32x4_t)a.v[i]);
#else
  EVS_PARTS for (int j = 0; j < PART; j++) a.v[i][j] = __builtin_sqrtf(a.v[i][j]);
#endif
  return a;
}
EVS_INLINE unsigned to_bits(Mask a) {
  unsigned r = 0;
#if defined(__SSE2__)
  EVS_PARTS r |= static_cast<unsigned>(EVS_INTRINSIC(movemask_ps)((FloatPart)a.m[i])) << (i * PART);
#elif EVS_NEON
  // lanes i and i + 8 side by side, a byte each; keep the bits of both, and add all of them
  const uint16x8_t low = vuzp1q_u16((uint16x8_t)a.m[0], (uint16x8_t)a.m[1]);
  const uint16x8_t high = vuzp1q_u16((uint16x8_t)a.m[2], (uint16x8_t)a.m[3]);
  const uint16x8_t lanes = (uint16x8_t)vtrn1q_u8((uint8x16_t)low, (uint8x16_t)high);
  const uint16x8_t bits = {0x0101, 0x0202, 0x0404, 0x0808, 0x1010, 0x2020, 0x4040, 0x8080};
  r = vaddvq_u16(vandq_u16(lanes, bits));
#else
  EVS_PARTS for (int j = 0; j < PART; j++) r |= (a.m[i][j] & 1u) << (i * PART + j);
#endif
  return r;
}
EVS_INLINE Mask mask_from_bits(unsigned lanes) {
  Mask r;
#if EVS_NEON
  const IntPart all = static_cast<int>(lanes) - IntPart{}, bits = {1, 2, 4, 8};
  EVS_PARTS r.m[i] = (all >> (i * PART) & bits) != 0;
#else
  EVS_PARTS for (int j = 0; j < PART; j++) r.m[i][j] =
      -static_cast<int>((lanes >> (i * PART + j)) & 1u);
#endif
  return r;
}
EVS_INLINE Float gather(const float* base, Int at) {
  Float r;
#if EVS_VECTOR_BITS == 256
  EVS_PARTS r.v[i] = (FloatPart)_mm256_i32gather_ps(base, (__m256i)at.v[i], 4);
#elif EVS_NEON
  alignas(64) int index[LANES];
  store(index, at);
  __asm__("" : "+m"(index));  // as in gather_float4
  EVS_PARTS {
    const int* four = index + i * PART;
    r.v[i] = FloatPart{base[four[0]], base[four[1]], base[four[2]], base[four[3]]};
  }
#else
  EVS_PARTS for (int j = 0; j < PART; j++) r.v[i][j] = base[at.v[i][j]];
#endif
  return r;
}
#if EVS_NEON
EVS_INLINE float reduce_min(Float a) {
  auto both = [&](int i, int j) { return vminnmq_f32((float32x4_t)a.v[i], (float32x4_t)a.v[j]); };
  return vminnmvq_f32(vminnmq_f32(both(0, 1), both(2, 3)));
}
EVS_INLINE float reduce_max(Float a) {
  auto both = [&](int i, int j) { return vmaxnmq_f32((float32x4_t)a.v[i], (float32x4_t)a.v[j]); };
  return vmaxnmvq_f32(vmaxnmq_f32(both(0, 1), both(2, 3)));
}
#else
EVS_INLINE float reduce_min(Float a) {
  float r = a.v[0][0];
  EVS_PARTS for (int j = 0; j < PART; j++) r = a.v[i][j] < r ? a.v[i][j] : r;
  return r;
}
EVS_INLINE float reduce_max(Float a) {
  float r = a.v[0][0];
  EVS_PARTS for (int j = 0; j < PART; j++) r = a.v[i][j] > r ? a.v[i][j] : r;
  return r;
}
#endif
EVS_INLINE void scatter(float* base, Int at, Float a, Mask m) {
  for (unsigned lanes = to_bits(m); lanes; lanes &= lanes - 1) {
    int i = __builtin_ctz(lanes);
    base[at.v[i / PART][i % PART]] = a.v[i / PART][i % PART];
  }
}
// Write the lanes of m side by side; what follows them, up to 16, has no meaning.
#if EVS_NEON
struct CompressTable {
  unsigned char bytes[16][16];  // of four lanes, by their bits: where each byte comes from
};
constexpr CompressTable compress_table() {
  CompressTable table = {};
  for (int bits = 0; bits < 16; bits++) {
    int to = 0;
    for (int from = 0; from < 16; from++) {
      if (bits >> (from / 4) & 1) table.bytes[bits][to++] = static_cast<unsigned char>(from);
    }
  }
  return table;
}
constexpr CompressTable COMPRESS = compress_table();

EVS_INLINE void compress(float* p, Float a, Mask m) {
  const unsigned lanes = to_bits(m);
  EVS_PARTS {
    const unsigned four = lanes >> (i * PART) & 15;
    const uint8x16_t packed = vqtbl1q_u8((uint8x16_t)a.v[i], vld1q_u8(COMPRESS.bytes[four]));
    vst1q_f32(p, (float32x4_t)packed);
    p += __builtin_popcount(four);
  }
}
#else
EVS_INLINE void compress(float* p, Float a, Mask m) {
  for (unsigned lanes = to_bits(m); lanes; lanes &= lanes - 1) {
    int i = __builtin_ctz(lanes);
    *p++ = a.v[i / PART][i % PART];
  }
}
#endif
#undef EVS_BINARY
#undef EVS_PARTS
#endif
#endif

// shared by all builds

EVS_INLINE Mask operator>(Float a, Float b) { return b < a; }
EVS_INLINE Mask operator>=(Float a, Float b) { return b <= a; }
EVS_INLINE Float operator-(Float a) {
#if EVS_NEON
  for (FloatPart& part : a.v) part = (FloatPart)vnegq_f32((float32x4_t)part);
  return a;
#else
  return as_float(as_int(a) ^ splat(static_cast<int>(0x80000000u)));  // the sign's bit
#endif
}
EVS_INLINE Float operator+(Float a, float b) { return a + splat(b); }
EVS_INLINE Float operator-(Float a, float b) { return a - splat(b); }
EVS_INLINE Float operator*(Float a, float b) { return a * splat(b); }
EVS_INLINE Float operator+(float a, Float b) { return splat(a) + b; }
EVS_INLINE Float operator*(float a, Float b) { return splat(a) * b; }
EVS_INLINE Float operator-(float a, Float b) { return splat(a) - b; }
EVS_INLINE Float operator/(float a, Float b) { return splat(a) / b; }
EVS_INLINE Mask operator<(Float a, float b) { return a < splat(b); }
EVS_INLINE Mask operator>(Float a, float b) { return splat(b) < a; }
EVS_INLINE Mask operator<=(Float a, float b) { return a <= splat(b); }
EVS_INLINE Mask operator>=(Float a, float b) { return splat(b) <= a; }
EVS_INLINE Mask select(Mask m, Mask a, Mask b) { return (m & a) | (~m & b); }
EVS_INLINE bool any(Mask a) {
#if EVS_NEON
  return vmaxvq_u32((uint32x4_t)(a.m[0] | a.m[1] | (a.m[2] | a.m[3]))) != 0;
#else
  return to_bits(a) != 0;
#endif
}
EVS_INLINE int first_lane(unsigned lanes) { return __builtin_ctz(lanes); }
EVS_INLINE unsigned first_lanes(int count) { return count < LANES ? (1u << count) - 1 : ALL_LANES; }

// largest whole number <= a, for |a| < 2^31
EVS_INLINE Float floor(Float a) {
#if EVS_NEON
  for (FloatPart& part : a.v) part = (FloatPart)vrndmq_f32((float32x4_t)part) + 0.0f;  // never -0
  return a;
#else
  Float whole = to_float(truncate(a));
  return select(whole > a, whole - 1.0f, whole);
#endif
}

// 1 / a, where an a too small to divide by counts as 1e-20: no infinity, hence no 0 * inf = NaN
EVS_INLINE Float safe_inverse(Float a) { return 1.0f / select(abs(a) < 1e-20f, splat(1e-20f), a); }

// value of one lane, for the few loops over lanes
EVS_INLINE float lane(Float a, int i) {
  alignas(64) float values[LANES];
  store(values, a);
  return values[i];
}
EVS_INLINE int lane(Int a, int i) {
  alignas(64) int values[LANES];
  store(values, a);
  return values[i];
}

#if EVS_VECTOR_BITS != 32

// Four adjacent floats of each lane.
struct Float4 {
  Float first, second, third, fourth;
};

#if EVS_VECTOR_BITS >= 512
// Gather for 16 lanes. Out: the first float of every lane, the second of every lane, and so on.
EVS_INLINE void gather_float4_512(const float* base, const int* at, __m512* out) {
  auto quad = [&](int i) { return _mm_loadu_ps(base + 2l * at[i]); };
  __m512 q[4];
  _Pragma("GCC unroll 4") for (int i = 0; i < 4; i++) {
    q[i] = _mm512_castps128_ps512(quad(i));
    q[i] = _mm512_insertf32x4(q[i], quad(4 + i), 1);
    q[i] = _mm512_insertf32x4(q[i], quad(8 + i), 2);
    q[i] = _mm512_insertf32x4(q[i], quad(12 + i), 3);
  }
  // transpose within each 128 bits
  __m512d low = _mm512_castps_pd(_mm512_unpacklo_ps(q[0], q[1]));
  __m512d low_next = _mm512_castps_pd(_mm512_unpacklo_ps(q[2], q[3]));
  __m512d high = _mm512_castps_pd(_mm512_unpackhi_ps(q[0], q[1]));
  __m512d high_next = _mm512_castps_pd(_mm512_unpackhi_ps(q[2], q[3]));
  out[0] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, low_next));
  out[1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, low_next));
  out[2] = _mm512_castpd_ps(_mm512_unpacklo_pd(high, high_next));
  out[3] = _mm512_castpd_ps(_mm512_unpackhi_pd(high, high_next));
}
#endif

// Gather base[2 at] ... base[2 at + 3] for each lane, with one load a lane, which no gather
// instruction does.
EVS_INLINE Float4 gather_float4(const float* base, Int at) {
  alignas(64) int index[LANES];
  store(index, at);
  // read the indices from memory: extracting lanes from a register one by one is slower
  __asm__("" : "+m"(index));
#if EVS_VECTOR_BITS == 1024
  __m512 low[4], high[4];
  gather_float4_512(base, index, low);
  gather_float4_512(base, index + 16, high);
  return {{low[0], high[0]}, {low[1], high[1]}, {low[2], high[2]}, {low[3], high[3]}};
#elif EVS_VECTOR_BITS == 512
  __m512 q[4];
  gather_float4_512(base, index, q);
  return {{q[0]}, {q[1]}, {q[2]}, {q[3]}};
#elif EVS_VECTOR_BITS == 256
  // in registers: wide loads of what narrow stores have just written would wait for them
  Float4 out;
  for (int part = 0; part < PARTS; part++) {
    const int* in = index + part * PART;
    auto quad = [&](int i) {
      __m256 low = _mm256_castps128_ps256(_mm_loadu_ps(base + 2l * in[i]));
      return _mm256_insertf128_ps(low, _mm_loadu_ps(base + 2l * in[4 + i]), 1);
    };
    __m256 q0 = quad(0), q1 = quad(1), q2 = quad(2), q3 = quad(3);
    // transpose within each 128 bits
    __m256d low = _mm256_castps_pd(_mm256_unpacklo_ps(q0, q1));
    __m256d low_next = _mm256_castps_pd(_mm256_unpacklo_ps(q2, q3));
    __m256d high = _mm256_castps_pd(_mm256_unpackhi_ps(q0, q1));
    __m256d high_next = _mm256_castps_pd(_mm256_unpackhi_ps(q2, q3));
    out.first.v[part] = (FloatPart)_mm256_unpacklo_pd(low, low_next);
    out.second.v[part] = (FloatPart)_mm256_unpackhi_pd(low, low_next);
    out.third.v[part] = (FloatPart)_mm256_unpacklo_pd(high, high_next);
    out.fourth.v[part] = (FloatPart)_mm256_unpackhi_pd(high, high_next);
  }
  return out;
#elif EVS_NEON
  Float4 out;
  for (int part = 0; part < PARTS; part++) {
    auto quad = [&](int i) { return vld1q_f32(base + 2l * index[part * PART + i]); };
    const float32x4_t q0 = quad(0), q1 = quad(1), q2 = quad(2), q3 = quad(3);
    // transpose
    const float32x4_t low = vzip1q_f32(q0, q2), low_next = vzip1q_f32(q1, q3);
    const float32x4_t high = vzip2q_f32(q0, q2), high_next = vzip2q_f32(q1, q3);
    out.first.v[part] = (FloatPart)vzip1q_f32(low, low_next);
    out.second.v[part] = (FloatPart)vzip2q_f32(low, low_next);
    out.third.v[part] = (FloatPart)vzip1q_f32(high, high_next);
    out.fourth.v[part] = (FloatPart)vzip2q_f32(high, high_next);
  }
  return out;
#else
  alignas(64) float out[4][LANES];
  _Pragma("GCC unroll 4") for (int i = 0; i < LANES; i += 4) {
    const float *a = base + 2l * index[i], *b = base + 2l * index[i + 1];
    const float *c = base + 2l * index[i + 2], *d = base + 2l * index[i + 3];
#if defined(__SSE2__)
    __m128 q0 = _mm_loadu_ps(a), q1 = _mm_loadu_ps(b);
    __m128 q2 = _mm_loadu_ps(c), q3 = _mm_loadu_ps(d);
    _MM_TRANSPOSE4_PS(q0, q1, q2, q3);
    _mm_store_ps(out[0] + i, q0);
    _mm_store_ps(out[1] + i, q1);
    _mm_store_ps(out[2] + i, q2);
    _mm_store_ps(out[3] + i, q3);
#else
    for (int k = 0; k < 4; k++) {
      out[k][i] = a[k], out[k][i + 1] = b[k], out[k][i + 2] = c[k], out[k][i + 3] = d[k];
    }
#endif
  }
  return {load(out[0]), load(out[1]), load(out[2]), load(out[3])};
#endif
}
#endif

}  // namespace
}  // namespace evs::EVS_NAMESPACE
