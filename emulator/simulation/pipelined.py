"""PipelinedWorld: physics and light of later ticks are made while pixels work on this one.

Light does not depend on events unless a controller closes the loop, so in an open loop the two
halves of a tick may overlap. The packets are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Protocol

from evs.emulator.base.scene import F32, SceneSnapshot
from evs.emulator.camera.camera import Camera, RenderedFrame
from evs.emulator.simulation.world import World
from evs.msgs import EventPacket, EvsError

MOST_BYTES = 256 * 2**20
"""light that waits takes no more than that, but for one tick"""


class TickMeter(Protocol):
    """A Meter that counts ticks, in each thread by itself."""

    def begin_tick(self) -> None:
        """The thread's next tick starts now."""

    def skip(self) -> None:
        """The time since the thread's previous lap belongs to no stage."""

    def end_tick(self) -> None:
        """It is over."""


@dataclass(frozen=True)
class _Tick:
    """The light of one tick, for each camera; or why there is none."""

    t_us: int = 0
    frames: tuple[RenderedFrame, ...] = ()
    error: BaseException | None = None


Buffers = list[F32]
"""an array for the light of each camera"""


class PipelinedWorld:
    """A world whose light is made in a thread of its own, up to `depth` ticks before it is needed.

    It takes the place of the world in a run loop: step, finish, t_us, cameras. The live mujoco data
    is then of a later tick, so nobody else may step, read or save the world meanwhile.
    """

    def __init__(self, world: World, ticks: int, meter: TickMeter, depth: int) -> None:
        """Set up the buffers; the thread starts with the first step.

        Chunks (model.chunk) wait as a whole: depth is that many more, as far as MOST_BYTES goes.

        Args:
            world: The world; nobody else may step it meanwhile.
            ticks: No more than these are made.
            meter: The one that the world laps.
            depth: How many ticks ahead light is made.
        """
        self._world, self._meter = world, meter
        self._ticks, self._done = ticks, 0
        self.t_us = world.t_us
        """simulated time at the end of the last step, us"""
        self.cameras = world.cameras
        """as they were at the end of the last step"""
        self.data = world.data
        """the live mujoco.MjData, which is some ticks ahead"""
        self.chosen, self.substeps = world.chosen, world.substeps
        # what waits, what is being made and what was last handed out are never in one array
        depth += max(camera.config.model.chunk for camera in world.cameras) - 1
        tick_bytes = sum(light.nbytes for light in _buffers(world.cameras))
        depth = max(1, min(depth, MOST_BYTES // tick_bytes))
        self._used = _buffers(world.cameras)
        """where the light lies that was last handed out"""
        # the thread waits where none is free: neither queue needs a bound, nor the thread a clock
        self._free: SimpleQueue[Buffers] = SimpleQueue()
        self._made: SimpleQueue[tuple[_Tick, Buffers]] = SimpleQueue()
        for _ in range(depth + 1):
            self._free.put(_buffers(world.cameras))
        self._closing = False
        self._thread: Thread | None = None
        self._broken: BaseException | None = None

    def step(self) -> tuple[EventPacket, ...]:
        """The packets of the next tick. Raises what physics or renderer raised in it, ever again.

        EvsError behind the last tick and after `close`: no light is made any more.
        """
        if self._broken is not None:
            raise self._broken
        if self._closing:
            raise EvsError("light is no longer made ahead: it was closed; make another run of it")
        if self._thread is None:
            # cameras take their reference in the first, which is nobody else's yet
            tick = self._light(self._world.advance(), self._used)
            self._thread = Thread(target=self._make, name="evs light", daemon=True)
            self._thread.start()
        elif self._done == self._ticks:
            raise EvsError(f"all {self._ticks} ticks are done: make a longer run of it")
        else:
            self._free.put(self._used)
            tick, self._used = self._made.get()
            # waiting for light is no work of the pixels
            self._meter.skip()
        if tick.error is not None:
            self._broken = tick.error
            raise tick.error
        self.t_us = tick.t_us
        self._done += 1
        pairs = zip(self.cameras, tick.frames, strict=True)
        packets = (camera.observe_light(frame) for camera, frame in pairs)
        return tuple([packet for each in packets for packet in each])

    def finish(self) -> tuple[EventPacket, ...]:
        """The packets of ticks in an incomplete chunk (model.chunk)."""
        return self._world.finish()

    def close(self) -> None:
        """End the thread; what it has made beyond the last step is forgotten."""
        self._closing = True
        if self._thread is not None:
            # it may wait for a free buffer
            self._free.put(self._used)
            self._thread.join()

    def _make(self) -> None:
        """What the thread does.

        Physics goes one tick further before light is handed over: who takes it wants Python's lock,
        and that is free for long only while the next light is made.
        """
        made: tuple[_Tick, Buffers] | None = None
        failure: BaseException | None = None
        try:
            for _ in range(1, self._ticks):
                self._meter.begin_tick()
                snapshot = self._world.advance()
                if made is not None:
                    self._made.put(made)
                    made = None
                buffers = self._free.get()
                if self._closing:
                    return
                self._meter.skip()
                made = self._light(snapshot, buffers), buffers
                self._meter.end_tick()
        except BaseException as error:  # whatever it is, the run loop has to raise it
            failure = error
        if made is not None:
            self._made.put(made)
        if failure is not None:
            self._made.put((_Tick(error=failure), []))

    def _light(self, snapshot: SceneSnapshot, buffers: Buffers) -> _Tick:
        pairs = zip(self.cameras, buffers, strict=True)
        frames = tuple([camera.light(snapshot, into) for camera, into in pairs])
        return _Tick(self._world.start_us + snapshot.t_us, frames)

    @property
    def left_out(self) -> tuple[str, ...]:
        """See `World`."""
        return self._world.left_out


@contextmanager
def pipelined(
    world: World, ticks: int, meter: TickMeter, depth: int
) -> Iterator[World | PipelinedWorld]:
    """The world, or with `depth` over 0 one whose light is made up to so many ticks ahead."""
    if depth < 1:
        yield world
        return
    running = PipelinedWorld(world, ticks, meter, depth)
    try:
        yield running
    finally:
        running.close()


def _buffers(cameras: Sequence[Camera]) -> Buffers:
    """An array for the light of each."""
    return [camera.light_buffer() for camera in cameras]
