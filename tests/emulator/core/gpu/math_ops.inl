// Single operations of the wide code on bit patterns, from a counter: the same source on the CPU,
// in packets, and on the GPU, in threads.
#pragma once

#include "base/simd_math.inl"

namespace evs::EVS_NAMESPACE {
namespace {

constexpr int MATH_OPS = 18, FIRST_BINARY_OP = 9;

// Truncation and comparisons do not.
constexpr bool gives_float(int op) { return op != 3 && op != 15 && op != 16; }

// min, max and select.
constexpr bool may_keep_denormals(int op) { return op == 13 || op == 14 || op == 17; }

EVS_INLINE Int flag(Mask m) { return select(m, splat(1), splat(0)); }

// Apply an operation to floats given as bits. Out: bits.
EVS_INLINE Int math_op(int op, Int a_bits, Int b_bits) {
  Float a = as_float(a_bits), b = as_float(b_bits);
  switch (op) {
    case 0:
      return as_int(log2(a));
    case 1:
      return as_int(exp2(a));
    case 2:
      return as_int(floor(a));
    case 3:
      return truncate(a);
    case 4:
      return as_int(to_float(a_bits));
    case 5:
      return as_int(sqrt(a));
    case 6:
      return as_int(safe_inverse(a));
    case 7:
      return as_int(abs(a));
    case 8:
      return as_int(-a);
    case 9:
      return as_int(a + b);
    case 10:
      return as_int(a - b);
    case 11:
      return as_int(a * b);
    case 12:
      return as_int(a / b);
    case 13:
      return as_int(min(a, b));
    case 14:
      return as_int(max(a, b));
    case 15:
      return flag(a < b);
    case 16:
      return flag(a <= b);
    default:
      return as_int(select(a < b, a, b));
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE

namespace evs {

struct Operands {
  unsigned a, b;
};

// The operands of number `index`. Unary operations go through all patterns of bits; binary ones
// take random patterns, some close to each other, some with results about the smallest normal
// number.
EVS_INLINE Operands operands(bool binary, unsigned long long index) {
  if (!binary) return {static_cast<unsigned>(index), 0};
  unsigned long long h = index * 0x9e3779b97f4a7c15ull;
  h = (h ^ (h >> 30)) * 0xbf58476d1ce4e5b9ull;
  h = (h ^ (h >> 27)) * 0x94d049bb133111ebull;
  h = h ^ (h >> 31);
  unsigned a = static_cast<unsigned>(h), b = static_cast<unsigned>(h >> 32);
  int exponent = static_cast<int>(a >> 23 & 255u), other = -1,
      off = static_cast<int>(index >> 3 & 3);
  switch (index & 7) {
    case 1:  // neighbours
      return {a, a + (b & 15u) - 8u};
    case 2:  // products about 2^-126
      other = 127 - exponent + off;
      break;
    case 3:  // quotients about 2^-126
      other = exponent + 125 + off;
      break;
    case 4:  // sums and differences of small numbers
      a = (a & 0x80ffffffu), b = (b & 0x80ffffffu);
      break;
    default:
      break;
  }
  if (other >= 0 && other < 255) b = (b & 0x807fffffu) | static_cast<unsigned>(other) << 23;
  return {a, b};
}

}  // namespace evs
