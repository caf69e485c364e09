"""SnapshotHistory: the last two instants in which a world was seen, as few numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from evs.emulator.base.scene import F64, SceneSnapshot
from evs.emulator.state import Saved
from evs.emulator.world import MjData, SnapshotTaker
from evs.msgs import EvsError


class PastInstant(NamedTuple):
    """What a snapshot follows from."""

    t_us: int
    exposure_us: int
    places: F64
    """(n,) as in SnapshotTaker.places"""


class SnapshotHistory:
    """Takes snapshots, and remembers what the last two of them followed from."""

    def __init__(self, taker: SnapshotTaker) -> None:
        self._taker = taker
        self._kept: tuple[PastInstant, ...] = ()

    def part(self, taker: SnapshotTaker) -> None:
        """Take snapshots with another taker, of a copy of the model."""
        self._taker = taker

    def reset(self) -> None:
        """Forget them."""
        self._kept = ()

    def snapshot(self, data: MjData, t_us: int, exposure_us: int) -> SceneSnapshot:
        """A snapshot, of which nothing is remembered yet."""
        return self._taker.snapshot(data, t_us, exposure_us)

    def keep(self, snapshot: SceneSnapshot, only_first: bool = False) -> None:
        """Remember the snapshot that was just taken.

        Args:
            snapshot: It.
            only_first: Only if none is remembered yet.
        """
        if not (only_first and self._kept):
            moment = PastInstant(snapshot.t_us, snapshot.exposure_us, self._taker.places)
            self._kept = (moment, *self._kept[:1])

    def save(self) -> Saved:
        """Named arrays that `read` takes back."""
        times = [(moment.t_us, moment.exposure_us) for moment in self._kept]
        places = np.array([moment.places for moment in self._kept], np.float64)
        return {
            "times": np.array(times, np.int64).reshape(len(times), 2),
            "places": places.reshape(len(times), self._taker.places.size),
        }

    def read(self, saved: Saved, now_us: int) -> tuple[SnapshotHistory, list[SceneSnapshot]]:
        """Those that were saved at now_us, and their snapshots, the last one first.

        Raises EvsError.
        """
        times, places = saved["times"], saved["places"]
        sound = (
            len(places) == len(times) <= 2
            and times.shape[1] == 2
            and not (np.diff(times[:, 0]) >= 0).any()
            and not (times[:, 1] < 0).any()
        )
        if not sound or (len(times) and times[0, 0] != now_us):
            raise EvsError("saved state is damaged: its times are invalid; save it again")
        other = SnapshotHistory(self._taker)
        other._kept = tuple(
            PastInstant(t_us, exposure_us, place)
            for (t_us, exposure_us), place in zip(times.tolist(), places, strict=True)
        )
        return other, [self._taker.again(m.places, m.t_us, m.exposure_us) for m in other._kept]
