"""Shards of training data: one .npz file a scene, read with checks; a folder of them."""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, U8
from evs.emulator.base.small_files import open_file
from evs.msgs import EvsError
from evs_lab.training.settings import HEIGHT, WHITE_DN, WIDTH, Variant, read_settings, variants_of

I16 = npt.NDArray[np.int16]

ARRAYS = {
    "light": np.dtype(np.float32),
    "truth": np.dtype(np.float32),
    "phase": np.dtype(np.float32),
    "counts": np.dtype(np.uint8),
    "noisy_counts": np.dtype(np.uint8),
    "pixels": np.dtype(np.int16),
}
TEXTS = ("variants", "meta")


@dataclass(frozen=True, eq=False)
class Shard:
    """One scene: P pixels in K ticks, noisy light in V variants, and the events of its truth.

    Raises:
        EvsError: something of it does not fit the rest.
    """

    light: F32
    """(V, K, P) linear luminance with the noise of each variant"""
    truth: F32
    """(K, P) linear luminance, converged"""
    phase: F32
    """(P,) in (-1, 1): how many thresholds the truth's references are below the first light, so
    that V(0) = phase"""
    counts: U8
    """(2, K, P) ON, OFF: events in each tick of an ideal pixel that sees `truth`; 0 in tick 0"""
    noisy_counts: U8
    """(2, K, P) the same of a pixel with a real sensor's noise"""
    pixels: I16
    """(P, 2) column, row"""
    variants: tuple[Variant, ...]
    """V of them"""
    meta: dict[str, Any]
    """its origin: settings, scene, versions, speeds"""

    def __post_init__(self) -> None:
        """Check shapes, types and values."""
        if self.truth.ndim != 2:
            raise EvsError(f"truth is {self.truth.shape}; it must be (ticks, pixels)")
        ticks, count = self.truth.shape
        shapes = {
            "light": (len(self.variants), ticks, count),
            "truth": (ticks, count),
            "phase": (count,),
            "counts": (2, ticks, count),
            "noisy_counts": (2, ticks, count),
            "pixels": (count, 2),
        }
        for name, dtype in ARRAYS.items():
            array = getattr(self, name)
            if array.dtype != dtype or array.shape != shapes[name]:
                raise EvsError(
                    f"{name} is {array.dtype} {array.shape}; it must be {dtype} {shapes[name]}"
                )
        for name in ("light", "truth"):
            array = getattr(self, name)
            # a NaN is not over 0 either
            if not (np.all(array >= 0) and np.all(np.isfinite(array))):
                raise EvsError(f"{name} holds a negative value, a NaN or Inf")
        if not np.all(np.abs(self.phase) < 1):
            raise EvsError("phase holds a value that is not between -1 and 1")
        if np.any(self.counts[:, :1]) or np.any(self.noisy_counts[:, :1]):
            raise EvsError("there are events in tick 0, which only sets the log light")
        if np.any(self.pixels < 0) or np.any(self.pixels >= (WIDTH, HEIGHT)):
            raise EvsError(f"a pixel lies outside the image of {WIDTH} x {HEIGHT} px")

    @property
    def ticks(self) -> int:
        """K."""
        return int(self.truth.shape[0])

    def variant(self, spp: int, seeds: str) -> F32:
        """(K, P) the light of one variant.

        Raises:
            EvsError: the shard has none such.
        """
        for place, one in enumerate(self.variants):
            if one == Variant(spp, seeds):
                return np.asarray(self.light[place])
        there = ", ".join(f"{one.spp} {one.seeds}" for one in self.variants)
        raise EvsError(f"there is no light of {spp} spp with {seeds} seeds; there is: {there}")


def shard_name(number: int) -> str:
    """The file of a scene's shard."""
    return f"{number:05d}.npz"


def write_shard(path: Path, shard: Shard) -> None:
    """Write a shard: the same bytes for the same values.

    The runner makes sure that a folder of data holds only complete shards.

    Raises:
        OSError: the disk is full, or the file cannot be written.
    """
    columns: dict[str, Any] = {name: getattr(shard, name) for name in ARRAYS}
    columns["variants"] = np.array(json.dumps([asdict(one) for one in shard.variants]))
    columns["meta"] = np.array(json.dumps(shard.meta, sort_keys=True))
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **columns)


def read_shard(path: str | os.PathLike[str]) -> Shard:
    """Read a shard, all of it.

    Raises:
        EvsError: no such file, damaged, not a shard.
    """
    found = Path(path)
    with _opened(found) as archive:
        missing = [name for name in (*ARRAYS, *TEXTS) if name not in archive]
        if missing:
            raise EvsError(f"{found} is no shard of training data: it lacks {', '.join(missing)}")
        arrays: dict[str, Any] = {name: archive[name] for name in ARRAYS}
        variants, meta = _texts(archive)
    try:
        return Shard(**arrays, variants=variants, meta=meta)
    except EvsError as reason:
        raise EvsError(f"{found}: {reason}; delete it and make it again") from None


def read_meta(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The `meta` of a shard, without its arrays. Raises EvsError as read_shard."""
    found = Path(path)
    with _opened(found) as archive:
        return _texts(archive)[1]


def _texts(archive: Any) -> tuple[tuple[Variant, ...], dict[str, Any]]:
    variants = variants_of(json.loads(str(archive["variants"][()])))
    meta = json.loads(str(archive["meta"][()]))
    if not isinstance(meta, dict):
        raise ValueError("meta is no table")
    return variants, meta


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open an archive; any error while the block runs becomes one line."""
    try:
        # numpy leaves a file open that it opened itself and found damaged
        with open_file(path) as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("it is no .npz file")
            with archive:
                yield archive
    except EvsError:
        raise
    except FileNotFoundError:
        raise EvsError(f"no shard {path}") from None
    except (
        *(OSError, EOFError, KeyError, TypeError, ValueError, IndexError, MemoryError),
        *(zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError),
    ) as reason:
        message = " ".join(str(reason).split()) or type(reason).__name__
        raise EvsError(f"cannot read {path}: {message}; delete it and make it again") from None


class Shards:
    """The shards of a folder, in the order of their scenes: len, [index], iteration.

    Each access reads the file again. Shards that appear later are not included.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        """Raises EvsError where there is no training data."""
        self.folder = Path(folder)
        self.settings = read_settings(self.folder)
        self.paths = tuple(
            sorted(path for path in self.folder.glob("[0-9]*.npz") if path.stem.isdecimal())
        )
        if not self.paths:
            raise EvsError(
                f"there is no shard in '{folder}' yet: make some with evs train data {folder}"
            )

    @property
    def numbers(self) -> tuple[int, ...]:
        """The scenes' numbers, in order."""
        return tuple(int(path.stem) for path in self.paths)

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Shard:
        """A shard by its place. Raises EvsError where it is damaged, IndexError as tuples do."""
        return read_shard(self.paths[index])

    def __iter__(self) -> Iterator[Shard]:
        return (read_shard(path) for path in self.paths)


LIGHT_STEP = 7
"""of the light, one tick in so many is described"""


def describe(shards: Shards) -> list[tuple[str, str]]:
    """Describe light, events, speeds and kinds of all shards, read one by one.

    Returns:
        (name, text) of each line.
    """
    light, events, noisy, medians, fastest = [], [], [], [], []
    values: dict[str, list[float]] = {}
    kinds: Counter[str] = Counter()
    for shard in shards:
        dn = WHITE_DN * shard.truth[::LIGHT_STEP]
        light.append(dn.ravel())
        medians.append(float(np.median(dn)))
        events.append(shard.counts.sum((0, 1), dtype=np.int64))
        noisy.append(shard.noisy_counts.sum((0, 1), dtype=np.int64))
        kinds[str(shard.meta.get("scene", {}).get("kind", "unknown"))] += 1
        seen = shard.meta.get("seen", {}).get("speeds_px_s")
        fastest.append(float(seen[-1]) if seen else 0.0)
        for key, value in shard.meta.get("randomised", {}).get("values", {}).items():
            values.setdefault(key, []).append(value)
    counts = np.concatenate(events)
    event_shares = _percentiles(counts, (50, 90, 99, 100))
    speeds = _percentiles(np.array(fastest), (0, 10, 25, 50, 75, 90, 100))
    return [
        ("scenes", f"{len(shards)}: " + ", ".join(f"{n} {k}" for k, n in sorted(kinds.items()))),
        ("pixels", f"{len(counts):,}, each {shards.settings.ticks} ticks"),
        ("light, DN", _percentiles(np.concatenate(light), (1, 5, 25, 50, 75, 95, 99))),
        ("median of a scene, DN", _percentiles(np.array(medians), (0, 10, 50, 90, 100))),
        ("pixels with events", f"{100 * np.mean(counts > 0):.3g} %"),
        ("events of a pixel", f"mean {counts.mean():.4g}; {event_shares}"),
        ("the same with noise", f"mean {np.concatenate(noisy).mean():.4g}"),
        ("fastest 1 % of a scene, px/s", speeds),
        *(
            (f"noisy {key}", f"{min(found):g} ... {max(found):g}, mean {np.mean(found):.4g}")
            for key, found in values.items()
        ),
    ]


def _percentiles(values: Any, shares: tuple[int, ...]) -> str:
    """Percentiles as text."""
    found = np.percentile(values, shares)
    return ", ".join(f"{share} %: {value:.3g}" for share, value in zip(shares, found, strict=True))
