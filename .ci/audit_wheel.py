"""What auditwheel does not ask of a wheel: python audit_wheel.py WHEEL.

A symbol that the linker found nowhere has no version, so that auditwheel passes it: it must be one
of Python's. And nothing of what is linked into the module may be visible from outside. The wheel
holds the package of the checkout in the working folder, and nothing else.
"""

from __future__ import annotations

import ast
import hashlib
import io
import re
import subprocess
import sys
import zipfile
from pathlib import Path

from elftools.elf.elffile import ELFFile

PACKAGES = ("msgs", "emulator", "drivers", "tools", "examples", "launch", "config")
NATIVE, ROS = "emulator/core/", "drivers/ros2/evs_camera_ros/"
"""Sources, of which the wheel has those that are compiled for a GPU; a package of its own."""


def expected() -> set[str]:
    """What the wheel is to hold, by what git does not ignore."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listing, capture_output=True, text=True, check=True).stdout.split("\0")
    compiler = Path("emulator/base/gpu/compiler.py").read_text()
    rooms = ast.literal_eval(re.search(r"^ROOMS = (\(.*?\))$", compiler, re.M)[1])
    on_gpu = tuple(f"{NATIVE}{room}/" for room in rooms)
    top = ("__init__.py", "__init__.pyi", "__main__.py", "py.typed")
    top += ("emulator/_core.so", "emulator/_core.pyi")
    return {f"evs/{name}" for name in top} | {
        f"evs/{name}"
        for name in files
        if name.split("/")[0] in PACKAGES
        and Path(name).is_file()
        and not name.startswith(ROS)
        and (not name.startswith(NATIVE) or (name.startswith(on_gpu) and not name.endswith(".cpp")))
    }


def faults(module: bytes) -> list[str]:
    """What is wrong with the native core, one line each."""
    elf = ELFFile(io.BytesIO(module))
    symbols = elf.get_section_by_name(".dynsym")
    versions = elf.get_section_by_name(".gnu.version")
    found = []
    for index, symbol in enumerate(symbols.iter_symbols()):
        undefined = symbol["st_shndx"] == "SHN_UNDEF"
        weak = symbol["st_info"]["bind"] == "STB_WEAK"
        if not symbol.name:
            continue
        if not undefined and symbol.name != "PyInit__core":
            found.append(f"{symbol.name} is visible from outside")
        has_version = versions.get_symbol(index)["ndx"] not in ("VER_NDX_LOCAL", "VER_NDX_GLOBAL")
        if undefined and not weak and not has_version and not symbol.name.startswith(("Py", "_Py")):
            found.append(f"{symbol.name} is in no library")
    return found


def audit(wheel: Path) -> list[str]:
    """Print what the wheel is, and return its faults."""
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB, ", end="")
    print(f"sha256 {hashlib.sha256(wheel.read_bytes()).hexdigest()[:16]}")
    archive = zipfile.ZipFile(wheel)
    (core,) = [name for name in archive.namelist() if name.endswith(".so")]
    held = {
        "evs/emulator/_core.so" if name == core else name
        for name in archive.namelist()
        if ".dist-info/" not in name and not name.endswith("/")
    }
    found = [f"{core}: {fault}" for fault in faults(archive.read(core))]
    found += [f"{name} is not of the package" for name in sorted(held - expected())]
    return found + [f"{name} is missing" for name in sorted(expected() - held)]


if __name__ == "__main__":
    wrong = audit(Path(sys.argv[1]))
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(bool(wrong))
