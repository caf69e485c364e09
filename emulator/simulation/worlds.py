"""Worlds: many worlds of one model on one clock each, stepped together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.memory_limits import cores
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.base.scene import F64
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.emulator.config.decoding import plain_integer
from evs.emulator.render.renderer_table import RENDERERS
from evs.emulator.simulation.world import World, over_at_once, reset_worlds, restore_worlds
from evs.emulator.simulation.world_batch import WorldBatch, stacked, why_one_by_one
from evs.emulator.world import (
    ControlFunction,
    Measurements,
    MjData,
    MjModel,
    Scene,
    UnstableError,
    Visual,
    has_callbacks,
)
from evs.msgs import Events, EvsError, StreamInfo

I64 = npt.NDArray[np.int64]

MAX_WORLDS = 65536

MAX_TICKS = 1_000_000
"""of a step, whose events are in memory at once"""

SEED_STEP = 65536
"""From one world's seed to the next one's: the cameras of a world have seeds of their own."""

Start = Callable[[int, MjData], None]
"""`f(world, data)` puts the data of a world where its episode begins."""


@dataclass(frozen=True, eq=False)
class WorldsEvents:
    """What one camera of each world saw: item i is the events of world i, a view."""

    events: Events
    """(N,) EVENT_DTYPE, world after world"""
    offsets: I64
    """(n + 1,) those of world i are events[offsets[i]:offsets[i + 1]]"""

    def __len__(self) -> int:
        """How many worlds there are."""
        return len(self.offsets) - 1

    def __getitem__(self, world: int) -> Events:
        """(k,) EVENT_DTYPE, those of a world, by time. IndexError: there is no such world."""
        number = range(len(self))[world]
        return self.events[self.offsets[number] : self.offsets[number + 1]]

    def __iter__(self) -> Iterator[Events]:
        """Those of one world after the other."""
        return (self[world] for world in range(len(self)))

    @property
    def counts(self) -> I64:
        """(n,) how many events each world has."""
        return np.diff(self.offsets)


class Worlds:
    """Worlds of one model, each with its own state, seed and cameras of the same kind.

        worlds = Worlds("humanoid.xml", 16)
        worlds.add_camera("track", sensor=SensorConfig(preset="ideal", width=64, height=64))
        for _ in range(100):
            (seen,) = worlds.step(controls, ticks=10)     # controls (16, nu)
            seen[3]                                       # events of world 3

    World i gives the bytes of `World(scene, seed=worlds.seeds[i])`. A SceneConfig has its own
    control seed; world i then gives the bytes of `World(scene, seed=worlds.seeds[0])` after a reset
    to the seed of world i. If the physics of a world becomes unstable, only this world ends (see
    `ended`). The worlds share the model, so an edit of it shows in every world. A world that is
    reset with `scene` continues with its own copy.
    """

    def __init__(
        self,
        scene: Scene | SceneConfig,
        count: int,
        *,
        tick_us: int = 1000,
        control: str | ControlFunction = "auto",
        seed: int = 0,
        threads: int = 0,
        limits: Mapping[str, tuple[float, float]] | None = None,
        sensors: Iterable[str] | None = None,
        visual: Visual | None = None,
    ) -> None:
        """Load the scene once, and make several worlds of it.

        Args:
            scene: See `World`.
            count: Number of worlds.
            tick_us: See `World`.
            control: See `World`. A function is called for each world in turn.
            seed: The seed of world 0; world i has the seed `seed + 65536 * i`.
            threads: Worlds to step at once; 0: one per core.
            limits: Name of a sensor of the model -> (low, high); a world with a reading outside
                this range ends.
            sensors: Names of the sensors in `readings`; None: only limits are measured.
            visual: See `World`.

        Raises:
            EvsError: See `World`; or there is no world, or no such sensor.
        """
        count = plain_integer(count, "count")
        if not 1 <= count <= MAX_WORLDS:
            raise EvsError(f"count is {count}: give 1 ... {MAX_WORLDS} worlds")
        threads = plain_integer(threads, "threads")
        if threads < 0:
            raise EvsError(f"threads is {threads}; give 0 for one per core, or more")
        self._threads = threads or cores()
        # many worlds share the cores between them; few give all of them to each in turn
        self._side_by_side = count >= self._threads
        own = 1 if self._side_by_side else self._threads
        first = World(
            scene, tick_us=tick_us, control=control, seed=seed, threads=own, visual=visual
        )
        self._worlds = [first, *(first.twin() for _ in range(count - 1))]
        for number, world in enumerate(self._worlds):
            world.reset(first.seed + SEED_STEP * number)
        self._revisions = [first.revision] * count
        self._firsts: list[int] | None = None
        """one world of each model; None: not known since a world may have got another"""
        self._batch: WorldBatch | None = None
        self._reason: str | None = None
        self._measuring = Lock()
        self.ended: dict[int, str] = {}
        """world -> why it ended: its physics broke down, or a limit was left; it stands still until
        it is reset or restored"""
        self._measured: Measurements | None = None
        if isinstance(sensors, str) or not isinstance(sensors, Iterable | None):
            raise EvsError(f"sensors is {sensors!r}: give the names of several, such as ['angle']")
        if not isinstance(limits, Mapping | None):
            raise EvsError(f"limits is {limits!r}: give {{sensor: (low, high)}}")
        if limits or sensors is not None:
            self._measured = Measurements(first.model, count, limits, sensors or ())
            self._begin([*range(count)])

    def __len__(self) -> int:
        """How many worlds there are."""
        return len(self._worlds)

    def __repr__(self) -> str:
        names = ", ".join(self.cameras) or "no camera yet"
        return f"<evs.Worlds: {len(self)} of {names}>"

    def add_camera(
        self,
        camera: str | CameraConfig = "",
        *,
        sensor: str | SensorConfig = "davis346",
        render: RenderConfig | None = None,
        model: ModelConfig | None = None,
        name: str | None = None,
    ) -> StreamInfo:
        """Add a camera to every world.

        Args:
            camera: See `World.add_camera`.
            sensor: See `World.add_camera`.
            render: See `World.add_camera`.
            model: See `World.add_camera`.
            name: See `World.add_camera`.

        Returns:
            The constant facts of its stream in world 0.

        Raises:
            EvsError: See `World.add_camera`; or `model.chunk` is greater than 1.
        """
        if model is not None and isinstance(model, ModelConfig) and model.chunk > 1:
            raise EvsError(
                f"model.chunk is {model.chunk}, but worlds are seen tick by tick: leave it 1"
            )
        self._settle(range(len(self)))
        first, *others = self._worlds
        made = first.add_camera(camera, sensor=sensor, render=render, model=model, name=name)
        for world in others:
            world.add_like(made)
        self._batch = self._reason = None
        return made.info

    def step(
        self, ctrl: npt.ArrayLike | None = None, ticks: int | npt.ArrayLike = 1
    ) -> tuple[WorldsEvents, ...]:
        """Advance every world that has not ended.

        Args:
            ctrl: (n, nu) controls from now on, one row per world, instead of the control source.
            ticks: Number of ticks; or (n,) one number per world, where 0 does not advance the
                world.

        Returns:
            The events in these ticks, one item per camera.

        Raises:
            EvsError: The controls have a wrong shape or are not finite, or no tick is positive. No
                world has moved.
        """
        wanted = self._checked_ticks(ticks)
        if ctrl is not None:
            self._take_controls(ctrl)
        self._see_edits()
        if self.one_by_one or has_callbacks():
            self._settle(range(len(self)))
            return self._step_one_by_one(wanted)
        return self._step_batch(wanted)

    def _checked_ticks(self, ticks: int | npt.ArrayLike) -> I64:
        """(n,) ticks of each world."""
        try:
            wanted = np.array(ticks)
        except ValueError:
            wanted = np.array(None)
        if wanted.dtype.kind not in "iu" or wanted.shape not in ((), (len(self),)):
            raise EvsError(f"ticks is {ticks!r}: give a whole number, or one for each world")
        if (wanted < 0).any() or not (wanted > 0).any():
            raise EvsError(f"ticks is {ticks!r}: a step is one tick or more")
        if (wanted > MAX_TICKS).any():
            raise EvsError(f"ticks is {ticks!r}: a step has {MAX_TICKS} ticks at most")
        wanted = np.broadcast_to(wanted, (len(self),)).astype(np.int64)
        wanted[[*self.ended]] = 0
        return wanted

    def _take_controls(self, ctrl: npt.ArrayLike) -> None:
        shape = (len(self), self.model.nu)
        try:
            values = np.array(ctrl, np.float64)
        except (TypeError, ValueError):
            raise EvsError(f"step(ctrl) got no numbers: give {shape} of them") from None
        if values.shape != shape:
            raise EvsError(
                f"step(ctrl) got controls of shape {values.shape}: give {shape}, a row for each "
                "world"
            )
        sound = np.isfinite(values).all(axis=1)
        if not sound.all():
            raise EvsError(
                f"step(ctrl) got a control that is not finite, for world {int(np.argmin(sound))}"
            )
        for world, row in zip(self._worlds, values, strict=True):
            world.given = row
        if self._batch is not None:
            self._batch.controls_changed()

    def _step_batch(self, ticks: I64) -> tuple[WorldsEvents, ...]:
        if self._batch is None:
            # with few worlds each has all threads for itself in turn
            threads = self._threads if self._side_by_side else 1
            self._batch = WorldBatch(self._worlds, threads, self._measured)
        batch = self._batch
        which = np.flatnonzero(ticks).astype(np.int32)
        batch.load(which)
        tick = 0
        while len(which):
            batch.control(which)
            ended = {number: str(reason) for number, reason in batch.step(which).items()}
            tick += 1
            if self._measured is not None:
                for number in ended:
                    self._measure_world(number)
                going = which[~np.isin(which, [*ended])]
                ended.update(self._measured.left(going.tolist()))
            self.ended.update(ended)
            which = which[(ticks[which] > tick) & ~np.isin(which, [*ended])]
        return tuple(WorldsEvents(*batch.take(place)) for place in range(len(self.cameras)))

    def _step_one_by_one(self, ticks: I64) -> tuple[WorldsEvents, ...]:
        def run(number: int) -> tuple[list[list[Events]], str]:
            world = self._worlds[number]
            found: list[list[Events]] = [[] for _ in world.cameras]
            for _ in range(int(ticks[number])):
                try:
                    packets = world.step()
                except UnstableError as reason:
                    return found, str(reason)
                for events, packet in zip(found, packets, strict=True):
                    events.append(packet.events)
                if self._measured is not None:
                    with self._measuring:
                        self._measure_world(number)
                        left = self._measured.left([number])
                    if left:
                        return found, left[number]
            return found, ""

        going = np.flatnonzero(ticks).tolist()
        at_once = min(self._threads, len(going)) if self._may_run_at_once else 1
        if at_once > 1:
            with ThreadPoolExecutor(at_once) as pool:
                results = dict(zip(going, pool.map(run, going), strict=True))
        else:
            results = {number: run(number) for number in going}
        for number, (_, reason) in results.items():
            if reason:
                self.ended[number] = reason
                self._measure([number])
        seen = []
        for place in range(len(self.cameras)):
            parts = [results[n][0][place] if n in results else [] for n in range(len(self))]
            every = [events for world in parts for events in world]
            seen.append(WorldsEvents(*stacked(every, [sum(map(len, one)) for one in parts])))
        return tuple(seen)

    @property
    def _may_run_at_once(self) -> bool:
        """Whether worlds may be stepped by several threads of Python."""
        first = self._worlds[0]
        # OpenGL belongs to a thread, and a control function of the caller's knows of none
        traced = all(RENDERERS[one.config.render.renderer].traced for one in first.cameras)
        return self._side_by_side and traced and not first.control.needs_data

    def _measure(self, worlds: Iterable[int]) -> None:
        """Measure worlds that are not in the batch."""
        for number in worlds:
            self._measure_world(number)

    def _measure_world(self, number: int) -> None:
        if self._measured is not None:
            world = self._worlds[number]
            self._measured.measure(number, world.data, world.model)

    def reset(
        self,
        seed: int | Sequence[int] | None = None,
        worlds: Iterable[int] | None = None,
        *,
        keyframe: str = "",
        sensor: str | SensorConfig | Sequence[str | SensorConfig] | None = None,
        scene: Mapping[str, float] | Sequence[Mapping[str, float]] | None = None,
        start: Start | None = None,
        must_run: bool = False,
    ) -> None:
        """Reset worlds, each as in `World.reset`.

        Args:
            seed: One seed, from which the seeds of all worlds follow as in the constructor, or one
                for each of `worlds`; None keeps the last.
            worlds: The numbers of the worlds; None: all.
            keyframe: See `World.reset`.
            sensor: See `World.reset`: one for all of `worlds`, or one for each.
            scene: See `World.reset`: values for all of `worlds`, or for each.
            start: Puts the MjData of a world into another state.
            must_run: Whether a start outside the limits, where an episode is over at once, is an
                error.

        Raises:
            EvsError: See `World.reset`; or a world does not exist, or the number of seeds,
                sensors or scenes is wrong. No world has changed.
        """
        chosen = self._chosen(worlds)
        seeds: list[int | None]
        if seed is None:
            seeds = [None] * len(chosen)
        elif not isinstance(seed, Iterable):
            seeds = [plain_integer(seed, "seed") + SEED_STEP * number for number in chosen]
        else:
            seeds = [plain_integer(one, "seed") for one in seed]
            if len(seeds) != len(chosen):
                raise EvsError(f"{len(seeds)} seeds for {len(chosen)} worlds: give one for each")
        sensors = _for_each(sensor, len(chosen), "sensors")
        scenes = _for_each(scene, len(chosen), "scenes")
        self._see_edits()
        self._settle(chosen)
        resets = [
            self._worlds[number].prepare_reset(one, keyframe, *others)
            for number, one, *others in zip(chosen, seeds, sensors, scenes, strict=True)
        ]
        self._firsts = None
        starts = [None if start is None else partial(start, number) for number in chosen]
        with (
            self._measured_as_before(chosen),
            reset_worlds([self._worlds[number] for number in chosen], resets, starts),
        ):
            self._begin(chosen)
            if must_run and (over := [n for n in chosen if n in self.ended]):
                raise over_at_once(self.ended[over[0]])
        # an edit that cannot be shown is reported by the next step, as in World
        with suppress(EvsError):
            self._see_rest(chosen)

    @contextmanager
    def _measured_as_before(self, worlds: list[int]) -> Iterator[None]:
        """What is known of these worlds' ends and measurements is so again if the block raises."""
        measured = self._measured.rows(worlds) if self._measured is not None else None
        with unchanged_on_error(self):
            try:
                yield
            except BaseException:
                if self._measured is not None and measured is not None:
                    self._measured.put_rows(worlds, measured)
                raise

    def _begin(self, worlds: list[int]) -> None:
        for number in worlds:
            self.ended.pop(number, None)
        self._measure(worlds)
        if self._measured is not None:
            self.ended.update(self._measured.left(worlds))

    def save(self, worlds: Iterable[int] | None = None, compress: bool = False) -> list[bytes]:
        """Save worlds. Each blob is that of World.save, and fits a World or any of these worlds.

        Args:
            worlds: The numbers of the worlds; None: all.
            compress: See `World.save`.
        """
        chosen = self._chosen(worlds)
        self._see_edits()
        self._settle(chosen)
        return [self._worlds[number].save(compress) for number in chosen]

    def restore(self, blobs: Iterable[bytes], worlds: Iterable[int] | None = None) -> None:
        """Continue from saved states of this or another process.

        Args:
            blobs: One for each of `worlds`.
            worlds: The numbers of the worlds; None: all.

        Raises:
            EvsError: See `World.restore`. No world has changed.
        """
        chosen, blobs = self._chosen(worlds), [*blobs]
        if len(blobs) != len(chosen):
            raise EvsError(f"{len(blobs)} states for {len(chosen)} worlds: give one for each")
        self._see_edits()
        self._settle(chosen)
        self._firsts = None
        restore_worlds([self._worlds[number] for number in chosen], blobs)
        self._see_rest(chosen)
        self._begin(chosen)

    def world(self, number: int) -> World:
        """One of the worlds in its present state: light, ground truth, physics, counters.

        Do not step it. Changes in it take effect in the next `step`.
        """
        (chosen,) = self._chosen([number])
        self._see_edits()
        self._firsts = None
        if self._batch is not None and self._batch.has(chosen):
            self._batch.settle(chosen)
            self._worlds[chosen].physics.update()
        return self._worlds[chosen]

    def _chosen(self, worlds: Iterable[int] | None) -> list[int]:
        if worlds is None:
            return [*range(len(self))]
        if not isinstance(worlds, Iterable):
            raise EvsError(f"worlds is {worlds!r}: give the numbers of several, such as [0, 2]")
        chosen = [plain_integer(one, "worlds") for one in worlds]
        for number in chosen:
            if not 0 <= number < len(self):
                raise EvsError(f"there is no world {number}: they are 0 ... {len(self) - 1}")
        if len(set(chosen)) < len(chosen):
            raise EvsError("worlds names a world twice")
        return chosen

    def _settle(self, worlds: Iterable[int]) -> None:
        if self._batch is not None:
            for number in worlds:
                self._batch.settle(number)

    def _see_edits(self) -> None:
        """Show edits of every model. Raises EvsError."""
        if self._firsts is None:
            firsts = {id(world.model): number for number, world in enumerate(self._worlds)}
            self._firsts = [*firsts.values()]
        now = [self._worlds[number].revision for number in self._firsts]
        if now != [self._revisions[number] for number in self._firsts]:
            self._settle(range(len(self)))
            self._batch = self._reason = None
            self._keep_revisions(range(len(self)))

    def _see_rest(self, chosen: list[int]) -> None:
        """After a reset or restore, which finds edits of texels and vertices too."""
        models = {id(self._worlds[number].model) for number in chosen}
        for number in sorted({*range(len(self))} - {*chosen}):
            world = self._worlds[number]
            if id(world.model) in models and world.revision != self._revisions[number]:
                # others show the same model
                self._settle(range(len(self)))
                self._batch = self._reason = None
                self._keep_revisions(range(len(self)))
                return
            models.discard(id(world.model))
        self._keep_revisions(chosen)

    def _keep_revisions(self, worlds: Iterable[int]) -> None:
        """What these worlds show is known: values of a scene are no edit of the caller's."""
        for number in worlds:
            self._revisions[number] = self._worlds[number].revision

    @property
    def one_by_one(self) -> str:
        """The reason why the worlds are stepped one by one, which is slower; "" if they are not."""
        if self._reason is None:
            # one world alone is stepped as quickly as it can be
            alone = "there is one world" if len(self) == 1 else ""
            self._reason = alone or why_one_by_one(self._worlds[0])
        return self._reason

    @property
    def model(self) -> MjModel:
        """The mujoco.MjModel of world 0, our own copy, which may be edited.

        All worlds that were not reset with their own values share it; see `world(i).model`.
        """
        return self._worlds[0].model

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras, in the order of `step`."""
        return tuple(camera.name for camera in self._worlds[0].cameras)

    @property
    def infos(self) -> tuple[StreamInfo, ...]:
        """The constant facts of the cameras' streams in world 0."""
        return tuple(camera.info for camera in self._worlds[0].cameras)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seed of each world, since its last reset."""
        return tuple(world.seed for world in self._worlds)

    @property
    def position(self) -> F64:
        """(n, actuators) float64, each world's encoders: rad or m, after any gear; a copy."""
        return self._measurements.position.copy()

    @property
    def velocity(self) -> F64:
        """(n, actuators) float64, the rates of the encoders, 1/s; a copy."""
        return self._measurements.velocity.copy()

    @property
    def readings(self) -> dict[str, F64]:
        """Readings of the named sensors: name -> (n, dimension) float64, copies."""
        return self._measurements.readings

    @property
    def _measurements(self) -> Measurements:
        if self._measured is None:
            raise EvsError("nothing is measured: make the worlds with sensors=() or with names")
        return self._measured

    @property
    def t_us(self) -> I64:
        """(n,) simulated time of each world, us."""
        batch = self._batch
        return np.array(
            [
                world.start_us + batch.t_us(number) if batch and batch.has(number) else world.t_us
                for number, world in enumerate(self._worlds)
            ],
            np.int64,
        )


def _for_each(given: Any, count: int, what: str) -> list[Any]:
    """One of a thing for each of `count` worlds. EvsError: there are more or fewer."""
    if isinstance(given, str) or not isinstance(given, Sequence):
        return [given] * count
    if len(given) != count:
        raise EvsError(f"{len(given)} {what} for {count} worlds: give one for each")
    return [*given]
