"""Ranges of a sensor's parameters in a file: its table [randomise]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evs.drivers import settings
from evs.msgs import EvsError


@dataclass(frozen=True)
class RandomiseFile:
    """A file of ranges."""

    randomise: Mapping[str, str] = field(default_factory=dict)
    """key of [sensor] -> its range"""


def read_ranges(file: str | Path) -> dict[str, str]:
    """Read the table [randomise] of a TOML file.

    Args:
        file: Which has this table and nothing else.

    Returns:
        Key of [sensor], dotted inside its tables -> its range, as of evs.SensorRanges.

    Raises:
        EvsError: The file cannot be read, or holds something else; the ranges are not checked.
    """
    path = Path(file).expanduser()
    try:
        found = settings.build(RandomiseFile, settings.read_toml(path))
    except EvsError as error:
        text = str(error)
        raise EvsError(text if str(path) in text else f"{path}: {text}") from None
    if not found.randomise:
        raise EvsError(f"{path}: there is no range; give it a table [randomise]")
    return dict(found.randomise)
