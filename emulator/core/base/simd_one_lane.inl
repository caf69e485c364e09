// Vectors of one lane: plain scalar code with the bytes of the wide code. Each lane of a wide
// vector depends on itself only, so a thread of a GPU can be a lane; on the CPU this is a test
// build.
//
// What C++ leaves open is written as x86 has it: a float that does not fit an int becomes
// 0x80000000.
#pragma once

#include "base/simd_target.h"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int LANES = 1;
constexpr unsigned ALL_LANES = 1;

struct Mask {
  bool m;
};
struct Float {
  float v;
};
struct Int {
  int v;
};

EVS_INLINE Float splat(float a) { return {a}; }
EVS_INLINE Int splat(int a) { return {a}; }
EVS_INLINE Float load(const float* p) { return {*p}; }
EVS_INLINE Int load(const int* p) { return {*p}; }
EVS_INLINE void store(float* p, Float a) { *p = a.v; }
EVS_INLINE void store(int* p, Int a) { *p = a.v; }

EVS_INLINE Int as_int(Float a) { return {__builtin_bit_cast(int, a.v)}; }
EVS_INLINE Float as_float(Int a) { return {__builtin_bit_cast(float, a.v)}; }
EVS_INLINE Float operator+(Float a, Float b) { return {a.v + b.v}; }
EVS_INLINE Float operator-(Float a, Float b) { return {a.v - b.v}; }
EVS_INLINE Float operator*(Float a, Float b) { return {a.v * b.v}; }
EVS_INLINE Float operator/(Float a, Float b) { return {a.v / b.v}; }
EVS_INLINE Float sqrt(Float a) { return {__builtin_sqrtf(a.v)}; }
EVS_INLINE Float min(Float a, Float b) { return {a.v < b.v ? a.v : b.v}; }
EVS_INLINE Float max(Float a, Float b) { return {a.v > b.v ? a.v : b.v}; }
EVS_INLINE Float abs(Float a) { return as_float({as_int(a).v & 0x7fffffff}); }
EVS_INLINE Mask operator<(Float a, Float b) { return {a.v < b.v}; }
EVS_INLINE Mask operator<=(Float a, Float b) { return {a.v <= b.v}; }
EVS_INLINE Mask operator==(Int a, Int b) { return {a.v == b.v}; }
EVS_INLINE Mask operator<(Int a, Int b) { return {a.v < b.v}; }
// unsigned: these may overflow
EVS_INLINE Int operator+(Int a, Int b) {
  return {static_cast<int>(static_cast<unsigned>(a.v) + static_cast<unsigned>(b.v))};
}
EVS_INLINE Int operator-(Int a, Int b) {
  return {static_cast<int>(static_cast<unsigned>(a.v) - static_cast<unsigned>(b.v))};
}
EVS_INLINE Int operator*(Int a, Int b) {
  return {static_cast<int>(static_cast<unsigned>(a.v) * static_cast<unsigned>(b.v))};
}
EVS_INLINE Int operator&(Int a, Int b) { return {a.v & b.v}; }
EVS_INLINE Int operator|(Int a, Int b) { return {a.v | b.v}; }
EVS_INLINE Int operator^(Int a, Int b) { return {a.v ^ b.v}; }
template <int N>
EVS_INLINE Int shift_right(Int a) {
  return {a.v >> N};
}
EVS_INLINE Int truncate(Float a) {
  bool fits = a.v >= -2147483648.0f && a.v < 2147483648.0f;
  int whole = fits ? static_cast<int>(a.v) : static_cast<int>(0x80000000u);
  // keep compilers from turning a conversion to int and back into a rounding, which gives -0
  __asm__("" : "+r"(whole));
  return {whole};
}
EVS_INLINE Float to_float(Int a) { return {static_cast<float>(a.v)}; }

EVS_INLINE Mask operator&(Mask a, Mask b) { return {a.m && b.m}; }
EVS_INLINE Mask operator|(Mask a, Mask b) { return {a.m || b.m}; }
EVS_INLINE Mask operator~(Mask a) { return {!a.m}; }
EVS_INLINE unsigned to_bits(Mask a) { return a.m; }
EVS_INLINE Mask mask_from_bits(unsigned lanes) { return {(lanes & 1u) != 0}; }
EVS_INLINE Float select(Mask m, Float a, Float b) { return {m.m ? a.v : b.v}; }
EVS_INLINE Int select(Mask m, Int a, Int b) { return {m.m ? a.v : b.v}; }
EVS_INLINE Float gather(const float* base, Int at) { return {base[at.v]}; }
EVS_INLINE void scatter(float* base, Int at, Float a, Mask m) {
  if (m.m) base[at.v] = a.v;
}
EVS_INLINE void compress(float* p, Float a, Mask m) {
  if (m.m) *p = a.v;
}
EVS_INLINE float reduce_min(Float a) { return a.v; }
EVS_INLINE float reduce_max(Float a) { return a.v; }

// Four adjacent floats of each lane.
struct Float4 {
  Float first, second, third, fourth;
};

// Gather base[2 at] ... base[2 at + 3].
EVS_INLINE Float4 gather_float4(const float* base, Int at) {
  const float* four = base + 2l * at.v;
  return {{four[0]}, {four[1]}, {four[2]}, {four[3]}};
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
