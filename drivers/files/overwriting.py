"""Existing files: no recording replaces one unless the user asks for it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count
from pathlib import Path

from evs.msgs import EvsError

FORCE = "use --force (in a pipeline: overwrite = true) to replace it"
"""the fix, for programs that take both"""


def check_new(paths: Iterable[str | Path], fix: str = "use --force to replace it") -> None:
    """Check that no file would be overwritten. Devices and pipes are not files.

    Args:
        paths: The files to be written.
        fix: How to overwrite them, for the message.

    Raises:
        EvsError: One of the files exists.
    """
    for path in map(Path, paths):
        if path.is_file():
            raise EvsError(f"'{path}' already exists: {fix}, or give another name")


def numbered_path(path: str, number: int) -> str:
    """The name of a recording next to earlier ones: run-1.aedat4; its own name for number 0."""
    own = Path(path)
    return str(own.with_name(f"{own.stem}-{number}{own.suffix}")) if number else path


def free_number(paths: Iterable[str]) -> int:
    """The lowest number for which none of the numbered paths exists."""
    wanted = list(paths)
    return next(
        n for n in count() if not any(Path(numbered_path(path, n)).exists() for path in wanted)
    )
