"""DataSettings: the settings of a folder of training data, in DIR/data.json."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.emulator.base.small_files import read_small_text
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.emulator.sensor.randomisation import DrawnSensor

SETTINGS_FILE = "data.json"

RECIPE = 1
"""Number of the recipe of scenes, light and pixels; data of another one cannot be continued."""

WIDTH, HEIGHT = 346, 260
"""px of the images that pixels are drawn from"""
WHITE_DN = 255.0
"""DN of white in the light that pixels see"""
MOST = {"pixels": 8192, "ticks": 1_000_000, "truth_spp": 4096}
LEAST = {"pixels": 1, "ticks": 2, "truth_spp": 1}


@dataclass(frozen=True)
class Variant:
    """One way to trace a scene's light."""

    spp: int
    """samples a pixel, 1 ... 4096"""
    seeds: str
    """fixed | fresh, as render.seeds"""


VARIANTS = tuple(Variant(spp, seeds) for seeds in ("fixed", "fresh") for spp in (1, 4, 16, 64))


@dataclass(frozen=True)
class DataSettings:
    """All inputs of a scene's shard except its number.

    Raises:
        EvsError: a value is out of range.
    """

    seed: int = 1
    """all that is random follows from it"""
    pixels: int = 2048
    """P, how many of a scene's image are traced"""
    truth_spp: int = 512
    """samples a pixel of converged light"""
    ticks: int = 448
    """K, ticks of a scene; the first only sets the log light"""
    variants: tuple[Variant, ...] = VARIANTS
    """of the noisy light, in the order of the shards"""
    tick_us: int = 1000
    """length of a tick, us"""
    recipe: int = RECIPE
    randomise: Mapping[str, str] = field(default_factory=dict)
    """ranges of the noisy sensor (targets.NOISY), as of evs.SensorRanges: another one in every
    scene"""

    def __post_init__(self) -> None:
        for key, most in MOST.items():
            value = getattr(self, key)
            if not LEAST[key] <= value <= most:
                raise EvsError(
                    f"training data: {key} is {value}; it must be {LEAST[key]} ... {most}"
                )
        if not 0 <= self.seed < 2**63:
            raise EvsError(f"training data: seed is {self.seed}; it must be 0 ... 2^63 - 1")
        if not self.variants:
            raise EvsError("training data: there is no variant of the light; give at least one")
        for variant in self.variants:
            if not 1 <= variant.spp <= 4096 or variant.seeds not in ("fixed", "fresh"):
                raise EvsError(
                    f"training data: {variant.spp} spp with {variant.seeds} seeds; spp is "
                    "1 ... 4096, seeds are fixed or fresh"
                )
        if self.randomise:
            self.draw(0)

    def draw(self, number: int) -> DrawnSensor | None:
        """The noisy sensor of scene `number`; None: it is the same in all scenes.

        Raises:
            EvsError: a range makes no sense.
        """
        if not self.randomise:
            return None
        # here, so that the settings are read quickly
        from evs.emulator.sensor.randomisation import SensorRanges
        from evs_lab.training.targets import NOISY

        return SensorRanges(self.randomise, NOISY).draw(self.seed, number)

    def plain(self) -> dict[str, Any]:
        """As JSON takes it."""
        plain = dataclasses.asdict(self)
        plain["variants"] = [dataclasses.asdict(variant) for variant in self.variants]
        if not self.randomise:
            # as before there were ranges
            del plain["randomise"]
        return plain

    @classmethod
    def of(cls, plain: Any, where: str) -> DataSettings:
        """The settings of such a table.

        Raises:
            EvsError: which names `where` it was read.
        """
        try:
            values = dict(plain)
            values["variants"] = variants_of(values["variants"])
            ranges = values.setdefault("randomise", {})
            if not all(type(text) is str for pair in ranges.items() for text in pair):
                raise ValueError
            kinds = {one.name for one in dataclasses.fields(cls)} - {"variants", "randomise"}
            if set(values) != kinds | {"variants", "randomise"}:
                raise ValueError
            if any(type(values[name]) is not int for name in kinds):
                raise ValueError
        except (AttributeError, KeyError, TypeError, ValueError):
            raise EvsError(
                f"{where} does not hold settings of training data; take an empty folder"
            ) from None
        return cls(**values)


def variants_of(plain: Any) -> tuple[Variant, ...]:
    """Variants from a JSON list. Raises ValueError or TypeError."""
    found = tuple(Variant(**entry) for entry in plain)
    if any(type(v.spp) is not int or type(v.seeds) is not str for v in found):
        raise ValueError("spp is a whole number, seeds a word")
    return found


def read_settings(folder: Path) -> DataSettings:
    """Settings of a folder of training data.

    Raises:
        EvsError: it has none.
    """
    path = folder / SETTINGS_FILE
    try:
        plain = json.loads(read_small_text(path))
    except (FileNotFoundError, NotADirectoryError):
        raise EvsError(
            f"no training data in '{folder}': make some with evs train data {folder}"
        ) from None
    except (OSError, ValueError) as reason:
        raise EvsError(f"cannot read {path}: {reason}") from None
    return DataSettings.of(plain, str(path))


def claim_folder(folder: Path, settings: DataSettings) -> None:
    """Make the folder one of these settings.

    Raises:
        EvsError: the folder has other settings, or other files.
    """
    path = folder / SETTINGS_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            if any(folder.glob("*.npz")):
                raise EvsError(f"'{folder}' has .npz files and no {SETTINGS_FILE}; take another")
            part = path.with_name(f".{path.name}.{os.getpid()}")
            part.write_text(json.dumps(settings.plain(), indent=2) + "\n", encoding="utf-8")
            part.replace(path)
            return
    except OSError as reason:
        raise EvsError(f"cannot write {path}: {reason.strerror}; take another folder") from None
    found = read_settings(folder)
    if found != settings:
        wanted, there = settings.plain(), found.plain()
        differ = [
            f"{key} {there.get(key, 'none')}, not {wanted.get(key, 'none')}"
            for key in dict.fromkeys([*wanted, *there])
            if wanted.get(key) != there.get(key)
        ]
        raise EvsError(
            f"'{folder}' holds training data of other settings ({'; '.join(differ)}); "
            "give those, or another folder"
        )
