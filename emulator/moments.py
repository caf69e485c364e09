"""Moments: the last two instants in which a world was seen, as few numbers."""

from __future__ import annotations

import numpy as np

from evs.emulator.saving import Saved
from evs.emulator.scene import F64, SceneSnapshot
from evs.emulator.world import MjData, Poser
from evs.msgs import EvsError


class Moments:
    """Takes snapshots, and remembers where everything was in the last two."""

    def __init__(self, poser: Poser, tick_us: int) -> None:
        self._poser, self._tick_us = poser, tick_us
        self._kept: tuple[tuple[int, F64], ...] = ()

    def reset(self) -> None:
        """Forget them."""
        self._kept = ()

    def first(self, data: MjData, t_us: int) -> SceneSnapshot:
        """A snapshot before a tick; remembered if there is none before it."""
        snapshot = self._poser.snapshot(data, t_us, self._tick_us)
        if not self._kept:
            self._kept = ((t_us, self._poser.places),)
        return snapshot

    def next(self, data: MjData, t_us: int) -> SceneSnapshot:
        """The snapshot after a tick."""
        snapshot = self._poser.snapshot(data, t_us, self._tick_us)
        self._kept = ((t_us, self._poser.places), *self._kept[:1])
        return snapshot

    def save(self) -> Saved:
        """Named arrays that `read` takes back."""
        places = np.array([one for _, one in self._kept], np.float64)
        return {
            "t_us": np.array([t_us for t_us, _ in self._kept], np.int64),
            "places": places.reshape(len(self._kept), self._poser.places.size),
        }

    def read(self, saved: Saved, now_us: int) -> tuple[Moments, list[SceneSnapshot]]:
        """Those that were saved at now_us, and their snapshots, the last one first.

        Raises EvsError.
        """
        t_us, places = saved["t_us"], saved["places"]
        sound = len(places) == len(t_us) <= 2 and not (np.diff(t_us) >= 0).any()
        if not sound or (len(t_us) and t_us[0] != now_us):
            raise EvsError("saved state is damaged: its times cannot be; save it again")
        other = Moments(self._poser, self._tick_us)
        other._kept = tuple(zip(t_us.tolist(), places, strict=True))
        seen = [self._poser.again(places, t_us, self._tick_us) for t_us, places in other._kept]
        return other, seen
