"""The light on a camera during a run, as small pictures for later use."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures.playback import Playback
from evs.msgs import Frame
from evs.msgs.pictures import U8, exposure_for, to_srgb8

LightOf = Callable[[Any], npt.NDArray[np.float32]]
"""From a world to the linear luminance (h, w) of its latest tick."""


class LightLog:
    """A run observer that stores the light of the first and of every `every`-th tick as grey.

    Each picture has (h, w) bytes. One exposure, of the first picture, applies to the whole run, so
    that grey levels are comparable over time.
    """

    def __init__(self, every: int, light_of: LightOf) -> None:
        self._every, self._light_of = every, light_of
        self._exposure = 0.0
        self.times_us: list[int] = []
        """ends of the ticks that were stored, ascending"""
        self.pictures: list[U8] = []
        """(h, w) grey each"""

    @classmethod
    def for_clip(cls, tick_us: int, light_of: LightOf) -> LightLog:
        """A log that has a picture for every frame of a clip at the default speed."""
        return cls(max(1, round(Playback(0, 1).step_us / tick_us)), light_of)

    def __call__(self, tick: int, world: Any, _packets: object) -> None:
        """Store the light at `world.t_us`, after tick `tick` (from 1) of a run, if it is due."""
        if tick % self._every and tick > 1:
            return
        self.keep(int(world.t_us), self._light_of(world))

    def keep(self, t_us: int, light: npt.NDArray[np.float32]) -> None:
        """Store one more picture: linear light (h, w) in any unit, no earlier than those before."""
        if not self.pictures:
            self._exposure = exposure_for(light)
        self.times_us.append(t_us)
        self.pictures.append(to_srgb8(light, self._exposure))

    def at(self, t_us: int) -> U8 | None:
        """The latest picture not after t_us, or else the first one; None without pictures."""
        if not self.pictures:
            return None
        return self.pictures[max(0, bisect.bisect_right(self.times_us, t_us) - 1)]

    def spread(self, count: int) -> list[int]:
        """Times of up to `count` pictures, us, ascending and evenly spread over the run."""
        last = len(self.times_us)
        places = {(index + 1) * last // (count + 1) for index in range(count)}
        return [self.times_us[place] for place in sorted(places) if place < last]


def recorded_light(frames: Sequence[Frame], width: int, height: int) -> LightLog | None:
    """The intensity frames of a recording, as light behind its events; None without any.

    A frame is shown from the end of its exposure on, one of a region in its place. Other frames of
    another size than the sensor's, (h, w) px, are left out.
    """
    placed = (frame.on_sensor(width, height) for frame in frames)
    shown = [frame for frame in placed if (frame.width, frame.height) == (width, height)]
    if not shown:
        return None
    log = LightLog(1, lambda world: world)
    for frame in sorted(shown, key=lambda one: one.exposure_end_us):
        log.keep(frame.exposure_end_us, np.asarray(frame.pixels, np.float32))
    return log
