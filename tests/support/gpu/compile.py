"""Compile the kernels of one lane for GPUs, by NVRTC: no GPU, no driver and no other compiler.

    python compile.py KERNEL ARCHITECTURE OUT [NAME=VALUE | OPTION]...

Writes PTX where OUT ends in .ptx, else machine code of that architecture (90: H100 and H200).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from evs.emulator.base.gpu.compiler import CORE, ROOMS, SAME_BYTES, compile_kernel

CHECKOUT = Path(__file__).parents[3]
TESTED = CHECKOUT / "tests/emulator/core/gpu"


def compiled(
    kernel: str,
    target: str,
    defined: Mapping[str, int] | None = None,
    options: Sequence[str] = SAME_BYTES,
) -> bytes:
    """Compile a kernel, as `compile_kernel` does.

    Args:
        kernel: Name of a file of emulator/core/ROOM/gpu or tests/emulator/core/gpu, without .cu.
        target: See `compile_kernel`.
        defined: See `compile_kernel`.
        options: See `compile_kernel`.
    """
    folders = (*(CORE / room / "gpu" for room in ROOMS), TESTED)
    folder = next(f for f in folders if (f / f"{kernel}.cu").is_file())
    includes = f"--include-path={CHECKOUT}"
    return compile_kernel(folder / f"{kernel}.cu", target, defined, (*options, includes))


def main() -> None:
    kernel, architecture, out = sys.argv[1:4]
    options, defined = [*SAME_BYTES], {}
    for word in sys.argv[4:]:
        name, _, value = word.partition("=")
        if not word.startswith("-"):
            defined[name] = int(value)
            continue
        # the later of two options of one name holds
        options = [known for known in options if known.split("=")[0] != name]
        options.append(word)
    target = ("compute_" if out.endswith(".ptx") else "sm_") + architecture
    started = time.monotonic()
    Path(out).write_bytes(compiled(kernel, target, defined, options))
    print(f"{kernel} {target} {time.monotonic() - started:.1f} s: {out}")


if __name__ == "__main__":
    main()
