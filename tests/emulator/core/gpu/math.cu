// Single operations: what each gives for operands `first` and those after it.
#include "base/gpu/prelude.h"

#include "tests/emulator/core/gpu/math_ops.inl"

namespace evs {

extern "C" __global__ void math(int op, unsigned long long first, int* out) {
  unsigned long long i = blockIdx.x * static_cast<unsigned long long>(blockDim.x) + threadIdx.x;
  Operands in = operands(op >= cuda::FIRST_BINARY_OP, first + i);
  out[i] = cuda::math_op(op, {static_cast<int>(in.a)}, {static_cast<int>(in.b)}).v;
}

}  // namespace evs
