"""Kernels for a GPU, compiled from the sources of the native core by NVRTC, and kept in a cache.

NVRTC needs no GPU, no driver and no other compiler.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from evs.emulator.base.gpu.driver import Gpu, compiler
from evs.emulator.base.package_paths import cache_folder
from evs.msgs import EvsError

CORE = Path(__file__).resolve().parents[2] / "core"
LANGUAGE = CORE / "base/gpu"
"""what NVRTC lacks of g++'s language and library"""
ROOMS = ("base", "scene", "render", "sensor", "evsnet")
"""folders of CORE whose headers kernels include, each by its path from CORE"""

SCAN_THREADS = 1024
"""of a block of a kernel that scans, as SCAN_THREADS of core/base/scan.h"""

SAME_BYTES = ("--fmad=false", "--prec-div=true", "--prec-sqrt=true", "--ftz=true")
"""IEEE rounding, no contraction to fma; denormals are flushed, as the CPU's worker threads do"""


def compile_kernel(
    source: Path,
    target: str,
    defined: Mapping[str, int] | None = None,
    options: Sequence[str] = SAME_BYTES,
) -> bytes:
    """Compile a file.

    Args:
        source: The file.
        target: "sm_90" gives machine code for that architecture, "compute_90" PTX.
        defined: Macros.
        options: What NVRTC is asked for besides.

    Raises:
        EvsError: It does not compile, or NVRTC is missing.
    """
    nvrtc = compiler()
    arguments = [
        "--std=c++20",
        "--device-as-default-execution-space",
        # pragmas and attributes of g++; tables of kernels that are only declared
        "--diag-suppress=161,1097,20044",
        f"--gpu-architecture={target}",
        f"--include-path={LANGUAGE / 'std'}",
        f"--include-path={CORE}",
        *(f"--define-macro={name}={value}" for name, value in (defined or {}).items()),
        *options,
    ]
    text = source.read_bytes()
    _, program = nvrtc.nvrtcCreateProgram(text, source.name.encode(), 0, [], [])
    (error,) = nvrtc.nvrtcCompileProgram(
        program, len(arguments), [argument.encode() for argument in arguments]
    )
    if error != nvrtc.nvrtcResult.NVRTC_SUCCESS:
        _, size = nvrtc.nvrtcGetProgramLogSize(program)
        # new bytes: NVRTC writes into them, and `b" " * 1` is the one that all of Python shares
        log = bytes(size)
        nvrtc.nvrtcGetProgramLog(program, log)
        nvrtc.nvrtcDestroyProgram(program)
        words = " ".join(log.rstrip(b"\0").decode(errors="replace").split())
        raise EvsError(f"{source.name} does not compile for {target}: {error.name}: {words[:400]}")
    machine_code = target.startswith("sm_")
    size_of = nvrtc.nvrtcGetCUBINSize if machine_code else nvrtc.nvrtcGetPTXSize
    get = nvrtc.nvrtcGetCUBIN if machine_code else nvrtc.nvrtcGetPTX
    _, size = size_of(program)
    code = bytes(size)
    get(program, code)
    nvrtc.nvrtcDestroyProgram(program)
    return code if machine_code else code.rstrip(b"\0")


def cached_kernel(name: str, architecture: int, defined: Mapping[str, int]) -> bytes:
    """Machine code of a kernel of CORE, from the cache where it is there.

    The keys of the cache cover the sources, the macros, the architecture and the compiler.

    Args:
        name: Folder and name of its file, such as "render/direct".
        architecture: Compute capability, such as 90.
        defined: Macros.

    Raises:
        EvsError: See `compile_kernel`.
    """
    told = sha256(repr((architecture, sorted(defined.items()), SAME_BYTES)).encode())
    _, *version = compiler().nvrtcVersion()
    told.update(repr(version).encode())
    for path in _sources():
        told.update(path.relative_to(CORE).as_posix().encode())
        told.update(path.read_bytes())
    room, kernel = name.split("/")
    kept = cache_folder("cuda") / f"{kernel}-sm_{architecture}-{told.hexdigest()[:24]}.cubin"
    try:
        return kept.read_bytes()
    except OSError:
        pass
    code = compile_kernel(CORE / room / f"gpu/{kernel}.cu", f"sm_{architecture}", defined)
    part = kept.with_suffix(f".{os.getpid()}.part")
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(code)
        part.replace(kept)
    except OSError:
        # a cache that cannot be written costs the next start its time, no more
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
    return code


def kernels_of(
    gpu: Gpu, name: str, functions: Sequence[str], defined: Mapping[str, int], prepare: str = ""
) -> list[Any]:
    """Kernels of a file of CORE, which is compiled and loaded once.

    Args:
        gpu: Where they run.
        name: See `cached_kernel`.
        functions: Names of the kernels.
        defined: Macros.
        prepare: A kernel of the file without parameters, which a single thread runs first.

    Raises:
        EvsError: See `compile_kernel`.
    """
    key = name, *sorted(defined.items())
    if key not in gpu.loaded:
        gpu.loaded[key] = module = gpu.load(cached_kernel(name, gpu.architecture, defined))
        if prepare:
            gpu.launch(gpu.kernel(module, prepare), (1, 1, 1), 1)
    return [gpu.kernel(gpu.loaded[key], function) for function in functions]


def _sources() -> list[Path]:
    """The files that kernels are made of."""
    found = [path for room in ROOMS for path in (CORE / room).rglob("*") if path.is_file()]
    return sorted(path for path in found if path.suffix != ".cpp")
