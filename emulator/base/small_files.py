"""Files that a configuration names, read whole: in bounded memory, and from regular files only."""

from __future__ import annotations

import errno
import stat
from pathlib import Path
from typing import BinaryIO

from evs.msgs import EvsError

MOST_BYTES = 1 << 24
"""Of settings and keys; what has more is none."""


def is_file(path: Path) -> bool:
    """Whether there is a regular file at a path.

    Raises:
        EvsError: The system does not say: no right to its folder, or a name that is too long.
    """
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        # ValueError: a null character in the name
        return False
    except OSError as reason:
        raise out_of_reach(path, reason) from None


def out_of_reach(path: object, reason: OSError) -> EvsError:
    """The error for a path that the system does not let us reach."""
    return EvsError(
        f"cannot reach '{path}': {reason.strerror}; give another path, or the rights to it"
    )


def open_file(path: Path) -> BinaryIO:
    """Open a file to read. OSError: as open's; also for pipes and devices."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(errno.EINVAL, "it is a pipe or a device; give a file")
    return path.open("rb")


def read_small(path: Path, most: int = MOST_BYTES) -> bytes:
    """A file's bytes. OSError: as open's; also for pipes and devices, and for more than `most`.

    A pipe would be waited for, and a device may never end.
    """
    with open_file(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"it has more than {most} bytes; give another file")
    return data


def read_small_text(path: Path, most: int = MOST_BYTES) -> str:
    """The same as text, ends of lines as Python has them. UnicodeDecodeError: it is not UTF-8."""
    text = read_small(path, most).decode()
    return text.replace("\r\n", "\n").replace("\r", "\n")
