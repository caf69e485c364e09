"""Do single operations give the same bits on a GPU as on this machine's processor?

    python measure.py LIBRARY

LIBRARY is tests/emulator/core/gpu/reference.cpp, built. Prints a line for each operation; the exit
code is the number of those that differ. Frames are compared by tests/emulator/render/
test_render_gpu.py, and timed by lab/tests/bench/test_gpu_speed.py.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import numpy as np
from compile import compiled

from evs.emulator.base.gpu.driver import the_gpu
from evs.emulator.base.memory_limits import cores

MATH = [
    *("log2", "exp2", "floor", "truncate", "to_float", "sqrt", "safe_inverse", "abs", "negate"),
    *("add", "subtract", "multiply", "divide", "min", "max", "less", "less_equal", "select"),
]
FIRST_BINARY = 9
CHUNK = 1 << 26
BLOCK = 256
PAIRS = 1 << 30
"""of operands, where there are two; others are all floats"""


class Difference(ctypes.Structure):
    """As in reference.cpp."""

    _fields_ = [(name, ctypes.c_uint64) for name in ("values", "nan_only", "zero_only", "at")] + [
        (name, ctypes.c_uint32) for name in ("a", "b", "cpu", "gpu")
    ]


def main() -> None:
    cpu, gpu = ctypes.CDLL(str(Path(sys.argv[1]).resolve())), the_gpu()
    print(f"{gpu.name}; {cores()} cores")
    kernel = gpu.kernel(gpu.load(compiled("math", f"sm_{gpu.architecture}")), "math")
    results, there = gpu.pinned((CHUNK,), np.int32), gpu.allocate(4 * CHUNK)
    differ = 0
    for op, name in enumerate(MATH):
        found, count = Difference(), 1 << 32 if op < FIRST_BINARY else PAIRS
        for first in range(0, count, CHUNK):
            told = np.int32([op]), np.uint64([first]), there.argument
            gpu.launch(kernel, (CHUNK // BLOCK, 1, 1), BLOCK, *told)
            gpu.download(results, there)
            cpu.math_compare(
                op, ctypes.c_uint64(first), ctypes.c_uint64(CHUNK),
                ctypes.c_void_p(results.ctypes.data), cores(), ctypes.byref(found),
            )  # fmt: skip
        line = f"{name}: {count} operands, {found.values} differ"
        line += f", {found.nan_only} are NaN of other bits"
        if found.values:
            differ += 1
            line += (
                f"; {found.zero_only} by the sign of zero; first: {found.a:08x}, {found.b:08x} "
                f"give {found.cpu:08x} here, {found.gpu:08x} there"
            )
        print(line, flush=True)
    raise SystemExit(differ)


if __name__ == "__main__":
    main()
