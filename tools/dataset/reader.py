"""Read a data set: its sequences, with their events, frames, poses and IMU samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.files import read, stream_of
from evs.msgs import Events, EvsError, ImuSamples, Labels, empty_events, empty_imu, unknown
from evs.tools.dataset.manifest import MANIFEST, read_json
from evs.tools.dataset.shards import EVENTS, FRAMES, POSE

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class LabelledEvents:
    """Events, and the cause of each."""

    array: Events
    """(n,) t us, x, y px, p"""
    labels: Labels | None
    """(n,) cause, geom_id; None if the event model gives no labels"""


class RecordedSequence:
    """One scene of a data set. Shards are read on request."""

    def __init__(self, folder: Path) -> None:
        """Open a scene.

        Args:
            folder: of the scene, with events/ and frames/ in it.
        """
        self.folder = folder
        self.name = folder.name

    @cached_property
    def _events(self) -> list[tuple[Path, int, int]]:
        """Folder of each shard, and the first and last stamp of its poses, which it covers."""
        found = []
        for path in sorted((self.folder / "events").iterdir()):
            with np.load(path / POSE) as poses:
                t_us = poses["t_us"]
            found.append((path, int(t_us[0]), int(t_us[-1])))
        return found

    @cached_property
    def sensor_values(self) -> dict[str, float]:
        """The values of a sensor that was drawn from ranges: key of [sensor] -> value; else empty.

        They are in the header of its recordings as well: config["randomised"]["values"].
        """
        values: dict[str, float] = self._randomised.get("values", {})
        return values

    @cached_property
    def scene_values(self) -> dict[str, float]:
        """The values of a scene that was drawn from ranges, as World.reset takes them; else empty.

        They are in the header of its recordings as well: config["randomised"]["scene"].
        """
        values: dict[str, float] = self._randomised.get("scene", {})
        return values

    @cached_property
    def _randomised(self) -> dict[str, Any]:
        stream = stream_of(self._events[0][0] / EVENTS)
        record: dict[str, Any] = stream.config.get("randomised", {})
        return record

    @property
    def time_us(self) -> tuple[int, int]:
        """End of the first tick with events, and of the last one."""
        return self._events[0][1], self._events[-1][2]

    def events(self, begin_us: int, end_us: int) -> LabelledEvents:
        """The events with begin_us < t <= end_us."""
        parts, labels = [], []
        for path, first_us, last_us in self._events:
            # a readout may hold events back, so those of a shard may be stamped in its neighbour's
            if first_us - 1_000_000 <= end_us and last_us + 1_000_000 >= begin_us:
                recording = read(path / EVENTS)
                chosen = (recording["t"] > begin_us) & (recording["t"] <= end_us)
                parts.append(np.asarray(recording)[chosen])
                if recording.labels is not None:
                    labels.append(recording.labels[chosen])
        if not parts:
            return LabelledEvents(empty_events(0), None)
        joined = np.concatenate(labels) if len(labels) == len(parts) else None
        return LabelledEvents(np.concatenate(parts), joined)

    def imu(self) -> ImuSamples:
        """(n,) all samples; none if the sensor has no IMU."""
        parts = [read(path / EVENTS).imu for path, _, _ in self._events]
        return np.concatenate(parts) if parts else empty_imu()

    def poses(self) -> Arrays:
        """t_us (n,), position (n, 3) m, orientation (n, 4) x y z w: the camera after each tick."""
        return _joined([_arrays(path / POSE) for path, _, _ in self._events])

    @cached_property
    def _frames(self) -> list[tuple[Path, int]]:
        found = []
        for path in sorted((self.folder / "frames").iterdir()):
            with np.load(path / FRAMES) as stacks:
                found.append((path / FRAMES, len(stacks["t_us"])))
        return found

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return sum(count for _, count in self._frames)

    def frame(self, index: int) -> Arrays:
        """The channels of a frame, by its number.

        Raises:
            EvsError: there is no such frame.
        """
        left = index
        for path, count in self._frames:
            if 0 <= left < count:
                return {name: stack[left] for name, stack in _arrays(path).items()}
            left -= count
        raise EvsError(f"{self.folder}: no frame {index}; there are {self.frame_count}")

    def frames(self) -> Iterator[Arrays]:
        """The channels of all frames, one frame after the other."""
        for path, count in self._frames:
            stacks = _arrays(path)
            yield from ({name: stack[i] for name, stack in stacks.items()} for i in range(count))


class Dataset:
    """A complete data set."""

    def __init__(self, folder: str | Path) -> None:
        """Open a data set.

        Args:
            folder: of the data set.

        Raises:
            EvsError: it has no manifest.
        """
        self.folder = Path(folder)
        self.manifest = read_json(self.folder / MANIFEST)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its scenes."""
        return tuple(self.manifest["scenes"])

    def __getitem__(self, name: str) -> RecordedSequence:
        if name not in self.names:
            raise unknown("scene", name, self.names)
        return RecordedSequence(self.folder / name)

    def __iter__(self) -> Iterator[RecordedSequence]:
        return (self[name] for name in self.names)


def _arrays(path: Path) -> Arrays:
    with np.load(path) as loaded:
        return dict(loaded)


def _joined(parts: list[Arrays]) -> Arrays:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
