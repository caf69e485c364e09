// Each operation of the wide code gives a lane what it gives one lane alone.

#include <cstdio>

#include "base/isa.h"
#include "base/thread_pool.h"
#include "tests/emulator/core/gpu/math_ops.inl"
#include "tests/emulator/core/selftest.h"

namespace evs {

unsigned one_lane_op(int op, unsigned a, unsigned b);  // lanes_one_lane.cpp

namespace {

bool is_nan(unsigned bits) { return (bits & 0x7fffffffu) > 0x7f800000u; }
bool is_denormal(unsigned bits) { return (bits & 0x7f800000u) == 0 && (bits & 0x7fffffu) != 0; }

// NaNs may have other bits. The least and the greatest of two is a choice, which may or may not
// flush a denormal; arithmetic flushes it in either case.
bool same(int op, Operands in, unsigned a, unsigned b) {
  if (a == b) return true;
  if (portable::gives_float(op) && is_nan(a) && is_nan(b)) return true;
  return portable::may_keep_denormals(op) && (is_denormal(in.a) || is_denormal(in.b));
}

}  // namespace

void lanes_depend_on_themselves_alone() {
  // ARM converts floats that do not fit an int in another way
  if (!EVS_X86) return;
  constexpr int RANDOM = 1 << 16, LANES = portable::LANES;
  // zeros, denormals, the least normal number, halves, what does not fit an int, infinity, NaN
  const unsigned special[LANES] = {0x00000000, 0x80000000, 0x00000001, 0x80000001,
                                   0x007fffff, 0x807fffff, 0x00800000, 0x80800000,
                                   0xbf000000, 0x3fc00000, 0xbfc00000, 0x4f000000,
                                   0xcf000000, 0x7f800000, 0xff800000, 0x7fc00000};
  FlushDenormals flush;
  for (int op = 0; op < portable::MATH_OPS; op++) {
    bool binary = op >= portable::FIRST_BINARY_OP, equal = true;
    for (int first = -LANES * LANES; first < RANDOM; first += LANES) {
      alignas(64) int a[LANES], b[LANES], wide[LANES];
      for (int i = 0; i < LANES; i++) {
        // a stride through all floats
        unsigned long long index = static_cast<unsigned>(first + i) * (binary ? 1ull : 65521ull);
        Operands in = operands(binary, index);
        if (first < 0) in = {special[i], special[(first + LANES * LANES) / LANES]};
        a[i] = static_cast<int>(in.a), b[i] = static_cast<int>(in.b);
      }
      portable::store(wide, portable::math_op(op, portable::load(a), portable::load(b)));
      for (int i = 0; i < LANES; i++) {
        Operands in = {static_cast<unsigned>(a[i]), static_cast<unsigned>(b[i])};
        unsigned alone = one_lane_op(op, in.a, in.b);
        if (same(op, in, static_cast<unsigned>(wide[i]), alone)) continue;
        if (equal)
          std::printf("operation %d of %08x, %08x: %08x and alone %08x\n", op, in.a, in.b,
                      static_cast<unsigned>(wide[i]), alone);
        equal = false;
      }
    }
    check(equal, "a lane's result is that of one lane alone");
  }
}

}  // namespace evs
