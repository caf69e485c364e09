"""Ranges of a sensor and a scene in a file, its table [randomise], and on a command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evs.emulator.config import decoding
from evs.msgs import EvsError

SCENE = "scene"
"""the table inside [randomise] whose ranges are the scene's"""


@dataclass(frozen=True)
class RandomiseFile:
    """A file of ranges."""

    randomise: Mapping[str, str] = field(default_factory=dict)
    """key of [sensor], or of the scene behind `scene.` -> its range"""


def split_ranges(randomise: Any) -> tuple[Any, Any]:
    """Ranges of a sensor and those of a scene.

    Args:
        randomise: Key of [sensor] -> its range, and those of the scene under `scene`: a table, or
            keys that begin with `scene.`, as a file and a command line give them.

    Returns:
        Key -> range of each, as evs.SensorRanges and evs.SceneRanges take and check them.
    """
    if not isinstance(randomise, Mapping):
        return randomise, {}
    sensor = dict(randomise)
    table = sensor.pop(SCENE, {})
    begin = f"{SCENE}."
    dotted = {str(key): text for key, text in sensor.items() if str(key).startswith(begin)}
    scene = {key.removeprefix(begin): text for key, text in dotted.items()}
    if isinstance(table, Mapping):
        table = {**scene, **table}
    return {key: text for key, text in sensor.items() if key not in dotted}, table


def read_ranges(file: str | Path) -> dict[str, str]:
    """Read the table [randomise] of a TOML file.

    Args:
        file: Which has this table and nothing else.

    Returns:
        Key, dotted inside its tables -> its range, as split_ranges takes them.

    Raises:
        EvsError: The file cannot be read, or holds something else; the ranges are not checked.
    """
    path = Path(file).expanduser()
    try:
        found = decoding.build(RandomiseFile, decoding.read_toml(path))
    except EvsError as error:
        text = str(error)
        raise EvsError(text if str(path) in text else f"{path}: {text}") from None
    if not found.randomise:
        raise EvsError(f"{path}: there is no range; give it a table [randomise]")
    return dict(found.randomise)


def range_overrides(words: Iterable[str]) -> list[tuple[str, str]]:
    """What --randomise gives, as dotted keys and texts for decoding.override.

    Args:
        words: Each a TOML file of ranges, or KEY=RANGE; later ones win.

    Raises:
        EvsError: A file cannot be read, or holds something else.
    """
    found = []
    for word in words:
        given = [decoding.split_word(word)] if "=" in word else read_ranges(word).items()
        found += [(f"randomise.{key.removeprefix('randomise.')}", text) for key, text in given]
    return found


def ranges_of(words: Iterable[str]) -> dict[str, str]:
    """The ranges that --randomise gives: key -> range; not checked.

    Raises:
        EvsError: As range_overrides.
    """
    return dict(decoding.override(RandomiseFile(), range_overrides(words)).randomise)
