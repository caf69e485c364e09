"""What a module for Macs with Apple silicon requires of them: python audit_macho.py MODULE LIST.

zig's linker leaves every symbol that it does not find to the Python that loads the module. So each
symbol without a library must be one of Python's. LIST is nanobind's file of these, as Apple's
linker reads it. The libraries must be those of macOS.
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import NamedTuple

# <mach-o/loader.h> and <mach-o/nlist.h>
MAGIC, ARM64, MODULES = 0xFEEDFACF, 0x0100000C, (6, 8)
SYMBOLS, LIBRARY, WEAK_LIBRARY, VERSION = 0x2, 0xC, 0x80000018, 0x32
DEBUGGING, TYPE, EXTERNAL, PRIVATE = 0xE0, 0x0E, 0x01, 0x10


class Module(NamedTuple):
    """What a Mach-O file names."""

    libraries: list[str]
    """The libraries that it loads."""
    macos: str
    """The oldest version that it runs on."""
    undefined: list[tuple[str, int]]
    """Symbols of others, and the number of the library that has each; there may be none."""
    visible: list[str]
    """Symbols that others can use."""

    def left(self) -> list[str]:
        """The symbols that no library has."""
        return [name for name, library in self.undefined if not 0 < library <= len(self.libraries)]


def text(data: bytes, start: int) -> str:
    """The string that begins there."""
    return data[start : data.index(b"\0", start)].decode()


def read(data: bytes) -> Module:
    """A module for 64-bit ARM.

    Raises:
        ValueError: It is something else.
    """
    magic, processor, _, kind, commands, _, _, _ = struct.unpack_from("<8I", data)
    if (magic, processor) != (MAGIC, ARM64) or kind not in MODULES:
        raise ValueError(f"no module for 64-bit ARM: {magic:#x}, {processor:#x}, {kind}")
    module = Module([], "?", [], [])
    position = 32
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", data, position)
        if command in (LIBRARY, WEAK_LIBRARY):
            (name,) = struct.unpack_from("<I", data, position + 8)
            module.libraries.append(text(data, position + name))
        elif command == VERSION:
            (oldest,) = struct.unpack_from("<I", data, position + 12)
            module = module._replace(macos=f"{oldest >> 16}.{oldest >> 8 & 0xFF}")
        elif command == SYMBOLS:
            start, count, strings, _ = struct.unpack_from("<4I", data, position + 8)
            for index in range(count):
                name, flags, _, hints, _ = struct.unpack_from("<IBBHQ", data, start + 16 * index)
                if flags & DEBUGGING or not flags & EXTERNAL:
                    continue
                if flags & TYPE == 0:
                    module.undefined.append((text(data, strings + name), hints >> 8))
                elif not flags & PRIVATE:
                    module.visible.append(text(data, strings + name))
        position += size
    return module


def faults(module: Module, of_python: set[str]) -> list[str]:
    """What is wrong with it, one line each."""
    found = [
        f"{library} is no library of macOS"
        for library in module.libraries
        if not library.startswith(("/usr/lib/", "/System/Library/"))
    ]
    found += [
        f"{symbol} is neither in Python nor in a library of macOS"
        for symbol in module.left()
        if symbol not in of_python
    ]
    if "_PyInit__core" not in module.visible:
        found.append("PyInit__core is missing")
    return found


def main(path: str, symbols: str) -> int:
    """Print what the module is, and its faults; 1 where it has some."""
    module = read(Path(path).read_bytes())
    left = len(module.left())
    print(f"{Path(path).name}: arm64, macOS {module.macos}; {left} symbols of Python, ", end="")
    print(f"{len(module.undefined) - left} of {', '.join(module.libraries)}")
    lines = Path(symbols).read_text().splitlines()
    wrong = faults(module, {line.split()[1] for line in lines if line.startswith("-U ")})
    print("\n".join(wrong), end="\n" if wrong else "")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
