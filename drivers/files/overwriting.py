"""What is there already: no recording takes its place unless that is asked for."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count
from pathlib import Path

from evs.msgs import EvsError

FORCE = "--force (in a pipeline: overwrite = true) replaces it"
"""the fix, where a program takes both"""


def check_new(paths: Iterable[str | Path], fix: str = "--force replaces it") -> None:
    """EvsError where one of these files is there. Devices and pipes take what they are given."""
    for path in map(Path, paths):
        if path.is_file():
            raise EvsError(f"'{path}' is there already: {fix}, or give another name")


def numbered_path(path: str, number: int) -> str:
    """run-1.aedat4: the name of a recording beside `number` earlier ones; 0: its own."""
    own = Path(path)
    return str(own.with_name(f"{own.stem}-{number}{own.suffix}")) if number else path


def free_number(paths: Iterable[str]) -> int:
    """The least number under which none of these is there."""
    wanted = list(paths)
    return next(
        n for n in count() if not any(Path(numbered_path(path, n)).exists() for path in wanted)
    )
