"""WorldBatch: ticks of many worlds of one model in a few calls, with the bytes of one by one.

MuJoCo steps all physics in one call, and one native call renders all cameras, steps their pixels
and reads them out, worlds side by side. A world that is loaded lives here; `settle` puts it back
into its World.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.scene import I32
from evs.emulator.camera.camera import Camera, LentCamera
from evs.emulator.simulation.device_batch import DeviceBatch, fit_together
from evs.emulator.simulation.world import World
from evs.emulator.world import Measurements, PhysicsBatch, PoseBatch, UnstableError, why_not_batched
from evs.msgs import EVENT_DTYPE, Events, EvsError

I64 = npt.NDArray[np.int64]


def why_one_by_one(world: World) -> str:
    """Why twins of this world cannot be stepped as a batch, as a reason; "": they can."""
    if reason := why_not_batched(world.model, world.visual):
        return reason
    if world.control.needs_data:
        return "the control is a function of the data"
    first: LentCamera | None = None
    for camera in world.cameras:
        lent = camera.lend()
        if isinstance(lent, str):
            return f"camera '{camera.name}': {lent}"
        if first is not None and not np.array_equal(first.renderer.lights, lent.renderer.lights):
            return "cameras differ in render.headlight"
        if first is not None and not fit_together(first, lent):
            return "cameras of a GPU differ in size or device"
        first = first or lent
    return "" if world.cameras else "there is no camera yet"


class WorldBatch:
    """Steps twins. Each is in its World, or loaded here."""

    def __init__(
        self, worlds: Sequence[World], threads: int, measured: Measurements | None = None
    ) -> None:
        """Set up; no world is loaded yet.

        Args:
            worlds: Twins to whose `why_one_by_one` there is no reason.
            threads: Cameras at once.
            measured: Where what they measure is written after each tick; None: nowhere.
        """
        first = worlds[0]
        self._worlds, self._tick_us = worlds, first.substeps.tick_us
        count = len(first.cameras)
        self._measured = measured
        stage = measured.stage if measured else 0
        self._physics = PhysicsBatch([world.physics for world in worlds], threads, stage)
        bounds = [[camera.bound for camera in world.cameras] for world in worlds]
        self._poses = PoseBatch(self._physics, first.model, bounds, first.visual)
        self._native = _core.CameraBatch(threads=threads, start_us=first.start_us)
        self._lights: npt.NDArray[np.intp] | None = None
        for place, world in enumerate(worlds):
            for camera in world.cameras:
                self._native.add(place)
                lights = _lent(camera).renderer.lights
                if len(lights) < self._poses.light_pos.shape[1]:
                    self._lights = lights
        self._device: DeviceBatch | None = None
        if _lent(first.cameras[0]).renderer.device is not None:
            self._device = DeviceBatch(self._native, len(worlds) * count)
        self._count = count
        self._numbers = np.arange(len(worlds) * count, dtype=np.int32).reshape(len(worlds), count)
        """of each world's cameras in the native batch"""
        self._lent: dict[int, list[LentCamera]] = {}
        """of the worlds that are loaded"""
        self._ticks = np.zeros(len(worlds), np.int64)
        """taken since they were"""
        self._events = np.zeros((len(worlds), count), np.int64)
        """in them, by camera"""
        self._places = self._physics.places
        """one tick ago"""
        self._is_controlled = np.zeros(len(worlds), bool)
        """whether it is loaded, and has the controls that were given to its World"""
        self._follows = np.zeros(len(worlds), bool)
        """whether its control source gives another control in each tick"""

    def load(self, which: I32) -> None:
        """Take in those of some worlds that are not here, and the controls that hold in them.

        Their cameras take their reference if they have none.

        Args:
            which: (k,) int32 their numbers.

        Raises:
            EvsError: See `World.step`.
        """
        for world in which[~self._is_controlled[which]].tolist():
            if world not in self._lent:
                self._load(world)
            one = self._worlds[world]
            given, source = one.given, one.control
            if given is None and source.is_constant:
                given = source(self._physics.t_us_of(world), one.data)
            if given is not None:
                self._physics.ctrl[world] = given
            self._follows[world] = one.given is None and not source.is_constant
            self._is_controlled[world] = True

    def _load(self, world: int) -> None:
        one = self._worlds[world]
        one.start_cameras()
        lent = [_lent(camera) for camera in one.cameras]
        for number, parts in zip(self._numbers[world].tolist(), lent, strict=True):
            state = parts.pixels.state
            self._native.put(
                number,
                parts.renderer.caster,
                parts.renderer.luminance,
                parts.pixels.model.array(state.seed),
                state.arrays(),
                seed=parts.renderer.seed,
                clock_us=state.clock_us,
                tick_us=state.tick_us,
                ticks=state.ticks,
                all_due=bool(state.all_due),
            )
            read, readout = parts.pixels.read, parts.pixels.readout
            if readout is not None and read is not None:
                t_us = one.physics.t_us
                readout.check_tick(read, t_us, t_us + self._tick_us)
                self._native.put_readout(
                    number, readout.native, read.clock, read.waiting, read.due_ns
                )
            if self._device is not None:
                self._device.put(number, parts)
        self._physics.load(world)
        self._poses.load(world, [camera.bound for camera in one.cameras])
        self._lent[world] = lent
        self._ticks[world] = 0
        self._events[world] = 0

    def settle(self, world: int) -> None:
        """Put a world back into its World, if it is loaded."""
        lent = self._lent.pop(world, None)
        if lent is None:
            return
        self._is_controlled[world] = False
        ticks = int(self._ticks[world])
        for number, parts in zip(self._numbers[world].tolist(), lent, strict=True):
            state = parts.pixels.state
            if self._device is not None:
                self._device.settle(number, ticks > 0)
            state.clock_us, state.tick_us, state.ticks, clamped = self._native.numbers(number)
            state.clamped += clamped
            state.all_due = 0 if ticks else state.all_due
            read = parts.pixels.read
            if read is not None and ticks:
                read.waiting, read.due_ns = self._native.waiting(number)
                read.t_us = np.array([self._physics.t_us_of(world)], np.int64)
        if not ticks:
            return
        self._physics.settle(world)
        places = self._physics.places_of(world)
        now, before = self._worlds[world].go_on(places, self._places[world])
        for place, camera in enumerate(self._worlds[world].cameras):
            camera.take_back(lent[place], ticks, int(self._events[world, place]), now, before)

    def has(self, world: int) -> bool:
        """Whether a world is loaded."""
        return world in self._lent

    def controls_changed(self) -> None:
        """Controls were given to Worlds; `load` takes them."""
        self._is_controlled[:] = False

    def control(self, which: I32) -> None:
        """Take the controls of a tick of loaded worlds from the sources that change them."""
        for world in which[self._follows[which]].tolist():
            one = self._worlds[world]
            values = one.control(self._physics.t_us_of(world), one.data)
            if values is not None:
                self._physics.ctrl[world] = values

    def t_us(self, world: int) -> int:
        """The time of a loaded world, us, as its Physics counts it."""
        return self._physics.t_us_of(world)

    def step(self, which: I32) -> dict[int, UnstableError]:
        """Take a tick of some worlds, which are loaded.

        Args:
            which: (k,) int32 their numbers, in order.

        Returns:
            Why physics broke down, by world; these have not moved.

        Raises:
            EvsError: More events than memory, or what waits in a readout does not fit its sensor.
        """
        places = self._physics.places
        failed = self._physics.advance(which)
        if failed:
            which = which[~np.isin(which, [*failed])]
        if self._measured is not None:
            self._physics.measure(which, self._measured)
        self._places[which] = places[which]
        end_us = self._physics.t_us
        self._poses.update(which, end_us)
        self._ticks[which] += 1
        poses, lights = self._poses, self._lights
        light_pos, light_dir = poses.light_pos, poses.light_dir
        if lights is not None:
            light_pos = np.ascontiguousarray(light_pos[:, lights])
            light_dir = np.ascontiguousarray(light_dir[:, lights])
        numbers, begin_us = self._numbers[which].reshape(-1), end_us - self._tick_us
        placed = (
            *(poses.geom_pos, poses.geom_mat, light_pos, light_dir),
            *(poses.camera_pos.reshape(-1, 3), poses.camera_mat.reshape(-1, 9)),
        )
        try:
            if self._device is not None:
                self._device.step(numbers, placed, begin_us, self._tick_us)
            else:
                self._native.step(numbers, placed, begin_us, self._tick_us)
        except MemoryError:
            raise EvsError(
                "the events of a tick do not fit in memory; raise the thresholds"
            ) from None
        except ValueError as reason:
            raise EvsError(str(reason)) from None
        return failed

    def take(self, camera: int) -> tuple[Events, I64]:
        """The events of a camera since the last call.

        Args:
            camera: Which one of each world.

        Returns:
            (N,) events, world after world; (n + 1,) where those of each world begin.
        """
        numbers = np.ascontiguousarray(self._numbers[:, camera])
        raw, offsets = self._native.take_events(numbers)
        self._events[:, camera] += np.diff(offsets)
        return raw.view(EVENT_DTYPE), offsets


def stacked(parts: Sequence[Events], counts: Sequence[int]) -> tuple[Events, I64]:
    """Events in one array, and where those of each world begin.

    Args:
        parts: World after world.
        counts: How many each world has.
    """
    offsets = np.concatenate([[0], np.cumsum(np.array(counts, np.int64))])
    # as bytes: NumPy's copy of fields leaves the padding out
    raw = [part.view(np.uint8).reshape(-1) for part in parts]
    joined = np.concatenate(raw) if raw else np.zeros(0, np.uint8)
    return joined.view(EVENT_DTYPE), offsets.astype(np.int64)


def _lent(camera: Camera) -> LentCamera:
    lent = camera.lend()
    assert isinstance(lent, LentCamera), lent
    return lent
