"""Compile the kernels of one lane for GPUs, by NVRTC: no GPU, no driver and no other compiler.

    python compile.py KERNEL ARCHITECTURE OUT [OPTION...]

Writes PTX where OUT ends in .ptx, else machine code of that architecture (90: H100 and H200).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from cuda.bindings import nvrtc

CORE = Path(__file__).resolve().parents[3] / "emulator/core"
KERNELS = CORE / "tests/cuda"
ROOMS = ("base", "scene", "render", "sensor", "evsnet")

# IEEE rounding, no contraction to fma; denormals are flushed, as the CPU's worker threads do
SAME_BYTES = ("--fmad=false", "--prec-div=true", "--prec-sqrt=true", "--ftz=true")


def compiled(kernel: str, target: str, options: tuple[str, ...] = SAME_BYTES) -> bytes:
    """Compile a kernel.

    Args:
        kernel: Name of a file of emulator/core/tests/cuda, without .cu.
        target: "sm_90" gives machine code, "compute_90" PTX.
        options: What NVRTC is asked for besides.

    Returns:
        The code. The log, if there is one, goes to stderr.

    Raises:
        SystemExit: It does not compile.
    """
    folders = (KERNELS, KERNELS / "std", *(CORE / room for room in ROOMS))
    arguments = [
        "--std=c++20",
        "--device-as-default-execution-space",
        # pragmas and attributes of g++; tables of kernels that are only declared
        "--diag-suppress=161,1097,20044",
        f"--gpu-architecture={target}",
        *(f"--include-path={folder}" for folder in folders),
        *options,
    ]
    source = (KERNELS / f"{kernel}.cu").read_text()
    _, program = nvrtc.nvrtcCreateProgram(source.encode(), f"{kernel}.cu".encode(), 0, [], [])
    (error,) = nvrtc.nvrtcCompileProgram(
        program, len(arguments), [argument.encode() for argument in arguments]
    )
    _, size = nvrtc.nvrtcGetProgramLogSize(program)
    # new bytes: NVRTC writes into them, and `b" " * 1` is the one that all of Python shares
    log = bytes(size)
    if size > 1:
        nvrtc.nvrtcGetProgramLog(program, log)
        print(log.rstrip(b"\0").decode(), file=sys.stderr)
    if error != nvrtc.nvrtcResult.NVRTC_SUCCESS:
        raise SystemExit(f"{kernel}.cu does not compile: {error}")
    machine_code = target.startswith("sm_")
    size_of = nvrtc.nvrtcGetCUBINSize if machine_code else nvrtc.nvrtcGetPTXSize
    get = nvrtc.nvrtcGetCUBIN if machine_code else nvrtc.nvrtcGetPTX
    _, size = size_of(program)
    code = bytes(size)
    get(program, code)
    return code if machine_code else code.rstrip(b"\0")


def main() -> None:
    kernel, architecture, out = sys.argv[1:4]
    options = [*SAME_BYTES]
    for option in sys.argv[4:]:
        # the later of two options of one name holds
        options = [known for known in options if known.split("=")[0] != option.split("=")[0]]
        options.append(option)
    target = ("compute_" if out.endswith(".ptx") else "sm_") + architecture
    started = time.monotonic()
    Path(out).write_bytes(compiled(kernel, target, tuple(options)))
    print(f"{kernel} {target} {time.monotonic() - started:.1f} s: {out}")


if __name__ == "__main__":
    main()
