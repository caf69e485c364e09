"""World: our own loop. A scene, its physics in exact ticks, any number of cameras on one clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple
from weakref import ref

import numpy as np
import numpy.typing as npt

from evs.emulator.base.protocols import Commit, Meter, NoMeter
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.base.scene import F64, SceneModel, SceneSnapshot
from evs.emulator.base.stamps import check_start
from evs.emulator.camera.camera import Camera
from evs.emulator.camera.view import View, camera_config
from evs.emulator.config import (
    CameraConfig,
    ModelConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
    VisualConfig,
)
from evs.emulator.config.decoding import plain_config, plain_integer
from evs.emulator.simulation.snapshot_history import SnapshotHistory
from evs.emulator.state import (
    Resumable,
    Saved,
    described,
    joined,
    part,
    unpack_here,
    whole,
    words,
)
from evs.emulator.world import (
    BoundCamera,
    ControlFunction,
    LiveScene,
    MjData,
    MjModel,
    ModelDigest,
    Physics,
    Scene,
    SceneValues,
    SnapshotTaker,
    Substeps,
    Visual,
    check_control,
    load_model,
    name_of_keyframe,
    resolve_visual,
    starting_keyframe,
    versions,
)
from evs.emulator.world.controls import ControlSource
from evs.msgs import EventPacket, EvsError


class World(Resumable):
    """A scene that evs steps, with any number of cameras.

        world = World("humanoid.xml", control="random")
        camera = world.add_camera("track")
        for (packet,) in world.run(2.0): ...

    Before the first step, you may put `world.data` into any state, whose light is then the
    reference. You may edit `world.model` between steps; the next step shows the changes. Vertices
    of meshes, heights,
    texels, skins and flexes are compared only in the first step after `reset`.
    """

    def __init__(
        self,
        scene: Scene | SceneConfig,
        *,
        tick_us: int = 1000,
        control: str | ControlFunction = "auto",
        seed: int = 0,
        threads: int = 0,
        meter: Meter | None = None,
        visual: Visual | None = None,
    ) -> None:
        """Load the scene.

        Args:
            scene: A path to MJCF or MJB, an MjModel or MjSpec (copied), or a SceneConfig, whose
                tick, control and keyframe are then used.
            tick_us: Length of a tick, us.
            control: "auto" (the controls of `home` if it starts there, else zero), "zero",
                "keyframe", "random", or a function `f(t_s, data) -> ctrl`.
            seed: Determines every random number of controls and sensors.
            threads: Worker threads of renderers and pixels; 0: one per core.
            meter: Measures the time of each stage.
            visual: Visible groups and flags, a mujoco.MjvOption or a VisualConfig; None: those of
                the SceneConfig, or otherwise MuJoCo's default.

        Raises:
            EvsError: The scene does not load, or an argument is invalid.
        """
        if isinstance(scene, SceneConfig):
            settings = plain_config(scene, "scene")
            source = settings.control if isinstance(control, str) else control
            if not settings.file:
                raise EvsError("scene.file is empty: name the .xml or .mjb file of a world")
            model = load_model(settings.file)
        else:
            settings = SceneConfig(
                file=str(scene) if isinstance(scene, str | Path) else "",
                tick_us=tick_us,
                control=control if isinstance(control, str) else "function",
                control_seed=plain_integer(seed, "seed"),
            )
            model, source = load_model(scene), control
        shown = resolve_visual(settings.visual if visual is None else visual)
        self._scene_config = settings = replace(settings, visual=shown)
        self.start_us = check_start(settings.start_us)
        """what its stamps begin at, us"""
        self._seed = plain_integer(seed, "seed")
        self._threads, self._meter = threads, meter or NoMeter()
        self.control = ControlSource(model, settings, source)
        """what gives the controls where `step` was given none"""
        self.given: F64 | None = None
        """(nu,) the controls that hold instead of the control source; None: it acts"""
        self.physics = Physics(model, settings.tick_us, self.control.keyframe)
        """its state, and how it is stepped"""
        self._scene = LiveScene(model, shown)
        self._taker = SnapshotTaker(model, visual=shown)
        self._history = SnapshotHistory(self._taker)
        self._cameras: list[Camera] = []
        # they hold the world, which would otherwise never be dropped with them
        self._view_refs: list[ref[View]] = []
        self._bounds: list[BoundCamera] = []
        """of cameras and views, in the order of a snapshot's poses"""
        self._digest, self._values = ModelDigest(model), SceneValues(model, shown)
        # a world that held itself would wait for the garbage collector
        self._twins: list[ref[World]] = [ref(self)]
        """those that share the model, this one too"""

    def __repr__(self) -> str:
        cameras = ", ".join(camera.name for camera in self._cameras) or "no camera yet"
        tick_us = self.substeps.tick_us
        return f"<evs.World: {cameras}; t {self.t_us * 1e-6:g} s, ticks of {tick_us} us>"

    @classmethod
    def from_config(cls, config: RunConfig, meter: Meter | None = None) -> World:
        """The world of a pipeline, with its camera. Raises EvsError.

        Headers have the keys of RunConfig, and none of a subclass.
        """
        world = cls(config.scene, seed=config.seed, threads=config.threads, meter=meter)
        world._add(config, config.name, whole=True)
        return world

    def twin(self) -> World:
        """Another world of the same model object, in its start state, without cameras.

        It has the same values of the scene and the start state that follows from them. Both share
        the model and its scene, so neither may edit the model alone. A twin that is reset with
        `scene` continues with a copy of the model.
        """
        other = World.__new__(World)
        other._scene_config, other.start_us = self._scene_config, self.start_us
        other._seed, other._threads, other._meter = self._seed, self._threads, NoMeter()
        other.control = self.control.copy()
        other.given = None
        other.physics = Physics(self.model, self.substeps.tick_us, self.control.keyframe)
        other.physics.substeps = self.substeps
        other._scene, other._digest = self._scene, self._digest
        other._values = self._values
        other.start_physics(self.control.keyframe)
        other._taker = SnapshotTaker(self.model, visual=self.visual)
        other._history = SnapshotHistory(other._taker)
        other._cameras, other._view_refs, other._bounds = [], [], []
        other._twins = self._twins
        self._twins.append(ref(other))
        return other

    def _part(self) -> None:
        """Have a model of one's own, a copy, where twins share it."""
        if all(one() in (None, self) for one in self._twins):
            return
        self._see_edits()
        self._twins[:] = [one for one in self._twins if one() is not self]
        self._twins = [ref(self)]
        model = self.physics.part()
        self._scene, self._values = self._scene.copy_for(model), self._values.copy_for(model)
        self._digest, self._taker = (
            ModelDigest(model),
            SnapshotTaker(model, self._bounds, self.visual),
        )
        self._history.part(self._taker)
        seers: list[Camera | View] = [*self._cameras, *self._views]
        for one in seers:
            one.part(model)

    def add_like(self, camera: Camera) -> Camera:
        """Add the camera of a twin with its own seed, on this world's clock."""
        config = replace(camera.config, seed=self._seed + len(self._cameras))
        return self._add(config, camera.name, like=camera)

    @classmethod
    def with_view(cls, config: RunConfig, rgb: bool = False) -> tuple[World, View]:
        """The world of a pipeline and a view through its camera, without pixels and events."""
        world = cls(config.scene, seed=config.seed, threads=config.threads)
        return world, world._add_view(config, rgb)

    def add_camera(
        self,
        camera: str | CameraConfig = "",
        *,
        sensor: str | SensorConfig = "davis346",
        render: RenderConfig | None = None,
        model: ModelConfig | None = None,
        name: str | None = None,
    ) -> Camera:
        """Add a camera on this world's clock; its packet is the last of each step.

        The pixels of camera n follow from seed + n, so no two cameras have the same noise.

        Args:
            camera: The name of one of the model's cameras, or a description; "" is the camera of
                the SceneConfig, else the first of the model, else a free camera.
            sensor: The name of a preset, or a configuration.
            render: How light reaches the pixels; None: the defaults.
            model: What turns light into events; None: the defaults.
            name: The name on the bus and in recordings; None: the name of the model's camera.

        Returns:
            The camera.

        Raises:
            EvsError: No such camera or preset, or an invalid configuration.
        """
        scene, seed = self._scene_config, self._seed + len(self._cameras)
        camera = scene.camera if camera == "" else camera
        own = camera_config(scene, camera, sensor, render, model, seed, self._threads)
        return self._add(own, name)

    def _add(
        self,
        config: RunConfig,
        name: str | None,
        *,
        whole: bool = False,
        like: Camera | None = None,
    ) -> Camera:
        self._see_edits()
        camera = Camera(
            self.model,
            self._scene.scene,
            config,
            name,
            place=len(self._bounds),
            taken=tuple(other.name for other in self._cameras),
            whole=whole,
            meter=self._meter,
            like=like,
        )
        self._pose(camera.bound)
        self._cameras.append(camera)
        return camera

    def add_view(
        self,
        camera: str | CameraConfig = "",
        *,
        sensor: str | SensorConfig = "davis346",
        render: RenderConfig | None = None,
        rgb: bool = False,
    ) -> View:
        """Add a view of the world without pixels and events: light and ground truth on request.

        Args:
            camera: See `add_camera`.
            sensor: Only its size is used.
            render: How light reaches the pixels; None: the defaults.
            rgb: Whether to render colour too.

        Returns:
            The view.

        Raises:
            EvsError: See `add_camera`.
        """
        scene, seed, threads = self._scene_config, self._seed, self._threads
        return self._add_view(
            camera_config(scene, camera, sensor, render, None, seed, threads), rgb
        )

    def _add_view(self, config: RunConfig, rgb: bool) -> View:
        self._see_edits()
        place, scene = len(self._bounds), self._scene.scene
        view = View(self.model, scene, config, place, rgb, self._snapshot)
        self._pose(view.bound)
        self._view_refs.append(ref(view))
        return view

    @property
    def _views(self) -> list[View]:
        """Those that somebody still has."""
        return [view for one in self._view_refs if (view := one()) is not None]

    def _pose(self, camera: BoundCamera) -> None:
        """Every snapshot from now on has one more camera's pose."""
        self._taker.add_camera(camera)
        self._bounds.append(camera)

    def _snapshot(self) -> SceneSnapshot:
        self._see_edits()
        return self._history.snapshot(self.data, self.physics.t_us, self.substeps.tick_us)

    def _see_edits(self, close: bool = True) -> None:
        """Show edits of the model. Raises EvsError.

        Args:
            close: See `LiveScene.outdated`.
        """
        if not self._scene.outdated(close):
            return
        scene = self._scene.extract()
        twins = [world for one in self._twins if (world := one()) is not None]
        commits = [world._prepare_refresh(scene) for world in twins]
        for commit in commits:
            commit()
        self._scene.taken(scene)

    def _prepare_refresh(self, scene: SceneModel) -> Commit:
        """Build what sees the edited model; the commit puts it in place."""
        seers: list[Camera | View] = [*self._cameras, *self._views]
        commits = [one.prepare_refresh(scene) for one in seers]

        def commit() -> None:
            for show in commits:
                show()
            for one in seers:
                self._bounds[one.place] = one.bound
            self._taker.fit(self._bounds)

        return commit

    def see_closely(self) -> bool:
        """Show edits of large arrays too; return whether there were edits. Raises EvsError."""
        before = self._scene.revision
        self._scene.compare_large_arrays()
        return self.revision != before

    @property
    def revision(self) -> int:
        """Number of times that edits of the model were shown, until now. Raises EvsError."""
        self._see_edits()
        return self._scene.revision

    def restore(self, blob: bytes) -> None:
        """See `Resumable.restore`."""
        restore_worlds([self], [blob])

    @contextmanager
    def values_of(self, blob: bytes) -> Iterator[None]:
        """Show the values of the scene of a saved state.

        If the block raises, the previous values are restored; see `with_values`.

        Args:
            blob: The result of `save`.

        Raises:
            EvsError: It is damaged.
        """
        values, before = described(blob).get("scene_values", {}), self._values.values
        try:
            values = self._values.check(values)
        except EvsError:
            # of another model, which is said where it is compared
            values = before
        with self.with_values(values):
            yield

    @contextmanager
    def with_values(self, values: Mapping[str, float] | None) -> Iterator[None]:
        """Show these values of the scene.

        If the block raises, model, cameras and views are restored, to the byte. Nothing else may
        change them in the block.

        Args:
            values: The result of `SceneValues.check`; None: the present values.

        Raises:
            EvsError: They are invalid. Nothing has changed.
        """
        if values is None or values == self._values.values:
            yield
            return
        self._see_edits(close=False)
        seers: list[Camera | View] = [*self._cameras, *self._views]
        with unchanged_on_error(self, self.physics, self._history, self._taker, *seers):
            self._part()
            with self._scene.unchanged_on_error(), self._values.putting(values):
                self._see_edits()
                yield

    def arrays(self) -> Saved:
        """What `save` packs, by name."""
        cameras = {f"cameras.{place}": one.save() for place, one in enumerate(self._cameras)}
        given = [] if self.given is None else [self.given]
        return {
            **joined(physics=self.physics.save(), moments=self._history.save(), **cameras),
            **words(seed=str(self._seed), control_seed=str(self.control.seed)),
            "given": np.array(given, np.float64).reshape(len(given), self.model.nu),
        }

    def prepare_restore(self, saved: Saved) -> Commit:
        """Check a saved state; the commit restores it. Raises EvsError."""
        physics = self.physics.prepare_restore(part(saved, "physics"))
        seed, control_seed = whole(saved, "seed"), whole(saved, "control_seed")
        given = saved["given"]
        if len(given) > 1 or given.shape[1] != self.model.nu or not np.isfinite(given).all():
            raise EvsError("saved state is damaged: its control is invalid; save it again")
        moments, seen = self._history.read(
            part(saved, "moments"), int(saved["physics.tick"]) * self.substeps.tick_us
        )
        now, previous = (*seen, None, None)[:2]
        cameras = [
            camera.prepare_restore(part(saved, f"cameras.{place}"), seed + place, now, previous)
            for place, camera in enumerate(self._cameras)
        ]

        def commit() -> None:
            self._seed = seed
            self.control.reseed(control_seed)
            self.given = given[0] if len(given) else None
            self._history = moments
            for restore in (physics, *cameras):
                restore()
            for view in self._views:
                view.reset(seed)
                for snapshot in reversed(seen):
                    view.move(snapshot)

        return commit

    @property
    def identity(self) -> dict[str, Any]:
        """What a saved state belongs to, in plain values: model, versions, event settings."""
        settings = asdict(self._scene_config)
        keys = ("start_us", "control", "control_file", "control_hz", "control_scale", "keyframe")
        return {
            "kind": "world",
            "versions": {key: versions()[key] for key in ("evs", "mujoco")},
            "scene": {"tick_us": self.substeps.tick_us, **{key: settings[key] for key in keys}},
            "model": self._digest(),
            "cameras": [camera.name for camera in self._cameras],
            "camera": {camera.name: camera.identity for camera in self._cameras},
            # a state of before there were any has none
            **({"scene_values": dict(values)} if (values := self._values.values) else {}),
            **({} if self.visual == VisualConfig() else {"visual": settings["visual"]}),
        }

    def go_on(self, places: F64, before: F64) -> tuple[SceneSnapshot, SceneSnapshot]:
        """Store the last two instants, after ticks that a batch has stepped.

        Args:
            places: See `SnapshotTaker.places`.
            before: One tick ago.

        Returns:
            Snapshots of now, and of one tick ago.
        """
        tick_us = self.substeps.tick_us
        taken = []
        for where, t_us in ((before, self.physics.t_us - tick_us), (places, self.physics.t_us)):
            taken.append(self._taker.again(where, t_us, tick_us))
            self._history.keep(taken[-1])
        return taken[1], taken[0]

    def step(self, ctrl: npt.ArrayLike | None = None) -> tuple[EventPacket, ...]:
        """Advance by one tick.

        Args:
            ctrl: (nu,) controls for this tick and the following ones, instead of the control
                source.

        Returns:
            One packet per camera. With model.chunk over 1 a camera returns none while its chunk
            fills, and then one for each tick.

        Raises:
            UnstableError: The physics became unstable; the packets until then are valid.
            EvsError: The controls have a wrong shape or are not finite.
        """
        if ctrl is not None:
            self.given = check_control(ctrl, self.model.nu, "step(ctrl)")
        snapshot = self.advance()
        return tuple([packet for camera in self._cameras for packet in camera.observe(snapshot)])

    def advance(self) -> SceneSnapshot:
        """The first half of `step`: advance the physics by one tick, without the cameras."""
        self.start_cameras()
        physics, values = self.physics, self.given
        if values is None:
            values = self.control(physics.t_us, physics.data)
        if values is not None:
            physics.data.ctrl[:] = values
        physics.advance()
        snapshot = self._snapshot()
        self._history.keep(snapshot)
        for view in self._views:
            view.move(snapshot)
        self._meter.lap("world")
        return snapshot

    def reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        sensor: str | SensorConfig | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> None:
        """Go back to the beginning: time, physics, pixels and counters.

        Until the next step you may put `world.data` into any state again.

        Args:
            seed: Determines all random numbers from now on, as in a new world with that seed; None
                keeps the last one.
            keyframe: Name or number of the keyframe to start from; "" is the keyframe of the
                constructor, "none" the model's own qpos0.
            sensor: Another sensor for every camera, as in evs.randomise_sensor; it must have the
                same size. This is faster than a new world. None keeps the last.
            scene: Values of the scene from now on, by key, as in evs.SceneRanges: lights, colours,
                masses, initial state. {}: the model's own; None keeps the last.

        Raises:
            EvsError: No such keyframe or key, invalid values, or an impossible sensor. Nothing has
                changed.
        """
        with reset_worlds([self], [self.prepare_reset(seed, keyframe, sensor, scene)]):
            pass

    def prepare_reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        sensor: str | SensorConfig | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> PreparedReset:
        """Check a reset, for `reset_worlds`.

        Arguments and errors are those of `reset`, but the values may still be invalid.
        """
        start = self.control.keyframe
        if keyframe != "":
            start = starting_keyframe(self.model, str(keyframe))
        if seed is not None:
            seed = plain_integer(seed, "seed")
        cameras = [
            camera.prepare_reset(None if seed is None else seed + place, sensor)
            for place, camera in enumerate(self._cameras)
        ]
        values = None if scene is None else self._values.check(scene)

        def commit() -> None:
            if seed is not None:
                # a control seed of its own keeps its distance
                self.control.reseed(self.control.seed + seed - self._seed)
                self._seed = seed
            self.given = None
            self._scene.compare_large_arrays()
            self._history.reset()
            for reset in cameras:
                reset()
            for view in self._views:
                view.reset(seed)

        return PreparedReset(start, values, commit)

    def start_physics(self, keyframe: int) -> None:
        """Put only the physics into the initial state of an episode.

        Args:
            keyframe: Id of the keyframe to start from; -1: qpos0.
        """
        self.physics.reset(keyframe, self._values.start)

    def finish(self) -> tuple[EventPacket, ...]:
        """The packets of ticks in an incomplete chunk (model.chunk)."""
        return tuple(packet for camera in self._cameras for packet in camera.finish())

    def run(self, duration_s: float) -> Iterator[tuple[EventPacket, ...]]:
        """Step for a duration, rounded to whole ticks but at least one; then call `finish`.

        Args:
            duration_s: Simulated time, s.

        Yields:
            The packets of each step.

        Raises:
            EvsError: The duration is not positive.
        """
        if not (duration_s > 0.0 and math.isfinite(duration_s)):
            raise EvsError(f"duration_s is {duration_s}: it must be over 0 s, for example 1.0")
        ticks = max(1, round(duration_s * 1e6 / self.substeps.tick_us))
        return self._run(ticks)

    def _run(self, ticks: int) -> Iterator[tuple[EventPacket, ...]]:
        for _ in range(ticks):
            yield self.step()
        if rest := self.finish():
            yield rest

    def start_cameras(self) -> None:
        """Set the light before this tick as the reference of cameras that have none yet."""
        new = [camera for camera in self._cameras if not camera.started]
        if new:
            snapshot = self._snapshot()
            self._history.keep(snapshot, only_first=True)
            for camera in new:
                camera.start(snapshot)
        for view in self._views:
            view.start()

    @property
    def visual(self) -> VisualConfig:
        """Groups and flags that are visible to its cameras."""
        return self._scene_config.visual

    @property
    def scene_values(self) -> dict[str, float]:
        """Values of the scene by key, since the last reset; other values are the model's own."""
        return dict(self._values.values)

    @property
    def model(self) -> MjModel:
        """The mujoco.MjModel, our own copy, which may be edited."""
        return self.physics.model

    @property
    def state(self) -> F64:
        """(n,) the complete state of the physics, mjSTATE_INTEGRATION; a copy."""
        return self.physics.state

    @property
    def data(self) -> MjData:
        """The live mujoco.MjData."""
        return self.physics.data

    @property
    def seed(self) -> int:
        """The seed of all random numbers, since the last reset."""
        return self._seed

    @property
    def t_us(self) -> int:
        """Simulated time, us, as in the stamps: scene.start_us at the beginning."""
        return self.start_us + self.physics.t_us

    @property
    def tick(self) -> int:
        """Number of completed ticks."""
        return self.physics.tick

    @property
    def substeps(self) -> Substeps:
        """How the model's time step was fitted to the tick; str() describes it."""
        return self.physics.substeps

    @property
    def keyframe(self) -> str:
        """Name or number of the initial keyframe; "": the model's own qpos0."""
        return name_of_keyframe(self.model, self.control.keyframe)

    @property
    def chosen(self) -> tuple[str, ...]:
        """One line for each automatic decision, with the key that overrides it."""
        lines = []
        if self.keyframe and not self._scene_config.keyframe:
            held = " and holds its control" if self.control.holds else ""
            lines.append(
                f"starts from keyframe '{self.keyframe}'{held}; scene.keyframe=none: from the "
                "model's qpos0"
            )
        if not self.substeps.kept:
            lines.append(str(self.substeps))
        return tuple(lines)

    @property
    def left_out(self) -> tuple[str, ...]:
        """One line for each thing that is not shown, with the fix; also issued as warnings."""
        lines = (line for camera in self._cameras for line in camera.left_out)
        return (*self._scene.scene.left_out, *dict.fromkeys(lines))

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All cameras, in the order of the packets."""
        return tuple(self._cameras)


class PreparedReset(NamedTuple):
    """A reset of a world that can be done."""

    keyframe: int
    """id of the keyframe to start from; -1: qpos0"""
    values: dict[str, float] | None
    """of the scene; None: those that hold"""
    commit: Commit
    """forgets all that the world has seen, with another seed and sensor if so wanted"""


def over_at_once(reason: str) -> EvsError:
    """The error of a start outside the limits."""
    return EvsError(
        f"the episode is over where it begins ({reason}): narrow start, or widen limits"
    )


@contextmanager
def reset_worlds(
    worlds: Sequence[World],
    resets: Sequence[PreparedReset],
    starts: Sequence[Callable[[MjData], None] | None] | None = None,
) -> Iterator[None]:
    """Reset worlds, all or none of them: if the block raises, nothing has changed.

    In the block, each has its values, and its physics is where the episode begins. Cameras are
    reset at the end.

    Args:
        worlds: The worlds.
        resets: What World.prepare_reset gave for each.
        starts: For each, what puts its data into another state; None: nothing.

    Raises:
        EvsError: Values make no model, or a start raises it.
    """
    starts = [None] * len(worlds) if starts is None else starts
    with ExitStack() as undo:
        for world in worlds:
            undo.enter_context(world.physics.unchanged_on_error())
        for world, reset in zip(worlds, resets, strict=True):
            undo.enter_context(world.with_values(reset.values))
        for world, reset, start in zip(worlds, resets, starts, strict=True):
            world.start_physics(reset.keyframe)
            if start is not None:
                start(world.data)
        yield
    for reset in resets:
        reset.commit()


def restore_worlds(worlds: Sequence[World], blobs: Sequence[bytes]) -> None:
    """Restore worlds, all or none of them.

    Args:
        worlds: The worlds.
        blobs: What World.save gave, for each.

    Raises:
        EvsError: See `World.restore`. Nothing has changed.
    """
    with ExitStack() as undo:
        for world, blob in zip(worlds, blobs, strict=True):
            undo.enter_context(world.values_of(blob))
        saved = [
            unpack_here(blob, world.identity, world.arrays())
            for world, blob in zip(worlds, blobs, strict=True)
        ]
        prepare_restore_worlds(worlds, saved)()


def prepare_restore_worlds(worlds: Sequence[World], saved: Sequence[Saved]) -> Commit:
    """Check saved states; the commit puts all of them in place.

    Args:
        worlds: The worlds, within `values_of` of their states.
        saved: One state for each world; see `World.prepare_restore`.

    Raises:
        EvsError: One is damaged; nothing has changed.
    """
    commits = [world.prepare_restore(one) for world, one in zip(worlds, saved, strict=True)]
    seen = [world.see_closely() for world in worlds]
    if any(seen):
        # the cameras have other renderers
        commits = [world.prepare_restore(one) for world, one in zip(worlds, saved, strict=True)]

    def commit() -> None:
        for one in commits:
            one()

    return commit
