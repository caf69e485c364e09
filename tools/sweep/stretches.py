"""A world that runs in stretches of as many ticks; within each, light is made ahead as ever."""

from __future__ import annotations

from collections.abc import Sequence

from evs.drivers.clock import StopWatch
from evs.emulator.camera.camera import Camera
from evs.emulator.simulation.pipelined import PipelinedWorld
from evs.emulator.simulation.world import World
from evs.msgs import EventPacket


class Stretches:
    """Takes the place of a world in a run loop. Between two stretches no thread is at work.

    So nothing of the next stretch is made while somebody measures something else. A stretch begins
    with no light in store: its first tick overlaps with nothing.
    """

    def __init__(self, world: World, ticks: int, watch: StopWatch, depth: int) -> None:
        """In: ticks of a stretch; depth, how many ticks ahead light is made, 0: none."""
        self._world, self._ticks, self._watch, self._depth = world, ticks, watch, depth
        self._now: World | PipelinedWorld = world
        self._left = 0

    def step(self) -> tuple[EventPacket, ...]:
        """The packets of the next tick."""
        if not self._left:
            self.close()
            self._left = self._ticks
            if self._depth:
                self._now = PipelinedWorld(self._world, self._ticks, self._watch, self._depth)
        self._left -= 1
        return self._now.step()

    def finish(self) -> tuple[EventPacket, ...]:
        """The packets of a chunk that is not full."""
        return self._now.finish()

    def close(self) -> None:
        """No thread is left."""
        if isinstance(self._now, PipelinedWorld):
            self._now.close()

    @property
    def cameras(self) -> Sequence[Camera]:
        """Of the world."""
        return self._now.cameras

    @property
    def t_us(self) -> int:
        """Of the last step."""
        return self._now.t_us

    @property
    def left_out(self) -> tuple[str, ...]:
        """Of the world."""
        return self._world.left_out

    @property
    def substeps(self) -> object:
        """Of the world."""
        return self._world.substeps
