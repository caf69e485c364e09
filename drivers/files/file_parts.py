"""The names of a recording in several files: run.aedat4, run-001.aedat4, ..."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from evs.msgs import EvsError


def part_path(path: Path, number: int) -> Path:
    """The file of part `number` of a recording; part 0 has the recording's own name."""
    return path.with_name(f"{path.stem}-{number:03d}{path.suffix}") if number else path


def later_parts(path: Path) -> list[Path]:
    """The existing further parts of a recording, in their order."""
    form = re.compile(re.escape(path.stem) + r"-(\d{3,9})" + re.escape(path.suffix))
    found: list[tuple[int, Path]] = []
    try:
        siblings = list(path.parent.iterdir())
    except OSError:
        # opening the file reports what is wrong with its folder
        return []
    for file in siblings:
        match = form.fullmatch(file.name)
        if match:
            found.append((int(match[1]), file))
    return [file for _, file in sorted(found)]


def check_no_parts(path: Path) -> None:
    """Check that no parts of an earlier recording would mix with those of a new one.

    The new recording would replace some of them, and leave others that look like its own.

    Raises:
        EvsError: There are such parts.
    """
    existing = later_parts(path)
    if existing:
        others = f" and {len(existing) - 1} more" if len(existing) > 1 else ""
        raise EvsError(
            f"{existing[0]}{others} of an earlier recording would mix with this one's: "
            "move them, or choose another name"
        )


def check_not_continued(path: Path, opened: Callable[[Path], object], parts: int = 1) -> None:
    """Check that no file of an earlier recording would be read as the next part of a new one.

    Args:
        path: The new recording.
        opened: Opens a file and reads its header; its result may have an attribute `part`.
        parts: How many files the new recording has.

    Raises:
        EvsError: The next file exists, and its header states that it is the next part.
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
