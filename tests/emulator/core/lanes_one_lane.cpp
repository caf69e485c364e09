// The one-lane side of lanes_test.cpp.
#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE one_lane
#include "tests/emulator/core/gpu/math_ops.inl"

namespace evs {

unsigned one_lane_op(int op, unsigned a, unsigned b) {
  return static_cast<unsigned>(
      one_lane::math_op(op, {static_cast<int>(a)}, {static_cast<int>(b)}).v);
}

}  // namespace evs
