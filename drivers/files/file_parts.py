"""The names of a recording that goes on in several files: run.aedat4, run-001.aedat4, ..."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from evs.msgs import EvsError


def part_path(path: Path, number: int) -> Path:
    """Where part `number` of a recording lies; part 0 has the recording's own name."""
    return path.with_name(f"{path.stem}-{number:03d}{path.suffix}") if number else path


def later_parts(path: Path) -> list[Path]:
    """The further parts of a recording that are there, in their order."""
    form = re.compile(re.escape(path.stem) + r"-(\d{3,9})" + re.escape(path.suffix))
    found: list[tuple[int, Path]] = []
    try:
        siblings = list(path.parent.iterdir())
    except OSError:
        # whoever opens the file says what is wrong with its folder
        return []
    for file in siblings:
        match = form.fullmatch(file.name)
        if match:
            found.append((int(match[1]), file))
    return [file for _, file in sorted(found)]


def check_no_parts(path: Path) -> None:
    """EvsError where an earlier recording of that name went on in further files.

    The new one would replace some of them, and leave others that look like its own.
    """
    there = later_parts(path)
    if there:
        others = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise EvsError(
            f"{there[0]}{others} of an earlier recording would mix with this one's: "
            "move them, or choose another name"
        )


def check_not_continued(path: Path, opened: Callable[[Path], object], parts: int = 1) -> None:
    """EvsError where the file behind a recording of so many parts says that it is the next one.

    A reader would take it for the new recording's. In: opened, what reads a file's header.
    """
    after = part_path(path, parts)
    if not after.is_file():
        return
    try:
        part = getattr(opened(after), "part", None)
    except EvsError:
        return
    if part == parts:
        raise EvsError(
            f"{after} of an earlier recording would mix with this one's: move it, or choose "
            "another name"
        )
