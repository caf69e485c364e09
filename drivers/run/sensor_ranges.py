"""Ranges of a sensor's parameters in a file, its table [randomise], and on a command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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


def range_overrides(words: Iterable[str]) -> list[tuple[str, str]]:
    """What --randomise gives, as dotted keys and texts for settings.override.

    Args:
        words: Each a TOML file of ranges, or KEY=RANGE; later ones win.

    Raises:
        EvsError: A file cannot be read, or holds something else.
    """
    found = []
    for word in words:
        given = [settings.split_word(word)] if "=" in word else read_ranges(word).items()
        found += [(f"randomise.{key.removeprefix('randomise.')}", text) for key, text in given]
    return found


def ranges_of(words: Iterable[str]) -> dict[str, str]:
    """The ranges that --randomise gives: key of [sensor] -> range; not checked.

    Raises:
        EvsError: As range_overrides.
    """
    ranges = RandomiseFile()
    for key, text in range_overrides(words):
        ranges = settings.override(ranges, key, text)
    return dict(ranges.randomise)
