"""The machine: Python, platform, processor, memory, and places to write to."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from evs.emulator.base.gpu.driver import the_gpu, why_no_gpu
from evs.emulator.base.memory_limits import cores, memory_gb
from evs.tools.doctor.check import BAD, NOTE, OK, Check

MIN_PYTHON = (3, 11)
ENOUGH_MEMORY_GB = 2.0
ENOUGH_DISK_GB = 1.0

CPU_FILE = Path("/proc/cpuinfo")


def check_python() -> Check:
    """The interpreter's version."""
    says = f"{platform.python_implementation()} {platform.python_version()}, {sys.executable}"
    if sys.version_info < MIN_PYTHON:
        wanted = ".".join(str(number) for number in MIN_PYTHON)
        return Check("python", BAD, says, f"install Python {wanted} or newer")
    return Check("python", OK, says)


def check_platform(system: str = sys.platform) -> Check:
    """Operating system and processor family.

    Args:
        system: sys.platform.
    """
    says = f"{platform.platform()}"
    if system.startswith("linux"):
        return Check("platform", OK, says)
    return Check("platform", NOTE, says, "evs is tested on Linux only")


def check_cores() -> Check:
    """Number of cores that this process may use, which threads = 0 means."""
    says = f"{cores()} usable of {os.cpu_count()}, {cpu_name()}"
    return Check("cpu", OK, says)


def check_gpu() -> Check:
    """An NVIDIA GPU that can render; to have none is no fault."""
    if reason := why_no_gpu():
        return Check("gpu", NOTE, reason, "only render.device=cuda and model.device=cuda need one")
    gpu = the_gpu()
    return Check("gpu", OK, f"{gpu.name}, compute capability {gpu.architecture / 10}")


def check_memory() -> Check:
    """Memory that is free for programs."""
    total_gb, free_gb = memory_gb()
    says = f"{free_gb:.1f} GB free of {total_gb:.1f} GB"
    if free_gb < ENOUGH_MEMORY_GB:
        return Check("memory", NOTE, says, "large meshes and long GIFs may not fit")
    return Check("memory", OK, says)


def check_disk(folders: Iterable[Path]) -> list[Check]:
    """Whether each folder is writable, and its free space."""
    return [_folder(folder) for folder in folders]


def cpu_name() -> str:
    """Name of the processor."""
    if CPU_FILE.is_file():
        for line in CPU_FILE.read_text(errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _folder(folder: Path) -> Check:
    name = f"disk {folder}"
    try:
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            file.write(b"evs" * 1000)
            file.flush()
            os.fsync(file.fileno())
        free_gb = shutil.disk_usage(folder).free / 1e9
    except OSError as reason:
        fix = f"make {folder} writable, or work in another folder"
        return Check(name, BAD, f"not writable: {reason.strerror}", fix)
    says = f"writable, {free_gb:.1f} GB free"
    if free_gb < ENOUGH_DISK_GB:
        return Check(name, NOTE, says, "a minute of a busy scene may need more: free some space")
    return Check(name, OK, says)
