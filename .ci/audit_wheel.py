"""What auditwheel does not ask of a wheel: python audit_wheel.py WHEEL.

A symbol that the linker found nowhere has no version, so that auditwheel passes it: it must be one
of Python's. And nothing of what is linked into the module may be visible from outside.
"""

from __future__ import annotations

import hashlib
import io
import sys
import zipfile
from pathlib import Path

from elftools.elf.elffile import ELFFile


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
    return [f"{core}: {fault}" for fault in faults(archive.read(core))]


if __name__ == "__main__":
    wrong = audit(Path(sys.argv[1]))
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(bool(wrong))
