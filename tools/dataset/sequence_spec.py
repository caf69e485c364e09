"""SequenceSpec: all inputs of the shards of a sequence, sent to every process that makes one."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import View, World
from evs.emulator.config import CameraConfig, RunConfig
from evs.emulator.sensor import resolve_sensor
from evs.emulator.sensor.randomisation import DrawnSensor
from evs.emulator.simulation.scene_ranges import DrawnScene
from evs.emulator.world import bytes_of
from evs.emulator.world.controls import read_controls
from evs.msgs import EvsError
from evs.tools.dataset.motion import Track, control_of
from evs.tools.dataset.scenes import FramesConfig, SceneFile, model_of
from evs.tools.jobs import job_threads


@dataclass(frozen=True, eq=False)
class SequenceSpec:
    """All inputs of one recorded sequence of a scene."""

    name: str
    """of the sequence: its folder"""
    scene: str
    """name of its scene"""
    model: bytes
    """MJB"""
    config: RunConfig
    """without the scene file, which may not exist on the machine that makes a shard"""
    tracks: tuple[Track, ...]
    rows: npt.NDArray[np.float64] | None
    """(n, nu) controls of a file"""
    frames: FramesConfig
    settle: int
    """ticks that the camera sees before the first; they are not recorded"""
    begin: int
    """the first tick"""
    end: int
    """the last one"""
    drawn: DrawnSensor | None = None
    """the sensor of this sequence, which `config` has; None: it is not randomised"""
    drawn_scene: DrawnScene | None = None
    """the values of its scene; None: it is not randomised"""

    @property
    def tick_us(self) -> int:
        """Length of a tick, us."""
        return self.config.scene.tick_us

    @contextmanager
    def with_model_file(self) -> Iterator[RunConfig]:
        """The configuration with a temporary file of the model and the threads of the job."""
        with tempfile.TemporaryDirectory(prefix="evs-dataset-") as folder:
            file = Path(folder, "scene.mjb")
            file.write_bytes(self.model)
            scene = replace(self.config.scene, file=str(file))
            yield replace(self.config, scene=scene, threads=job_threads() or self.config.threads)

    def recorded_config(self, config: RunConfig) -> RunConfig:
        """The configuration for the files, without what depends on the machine."""
        return replace(config, scene=replace(config.scene, file=self.scene), threads=0)

    @property
    def randomised(self) -> dict[str, Any]:
        """What the files say of a sensor and a scene that were drawn: {"randomised": ...}.

        Without ranges it is empty.
        """
        drawn = self.drawn or self.drawn_scene
        if drawn is None:
            return {}
        values = dict(self.drawn.values) if self.drawn else {}
        record = {"seed": drawn.seed, "episode": drawn.episode, "values": values}
        scene = {"scene": dict(self.drawn_scene.values)} if self.drawn_scene else {}
        return {"randomised": {**record, **scene}}

    def randomise(self, world: World) -> None:
        """Put the scene's values into a world that has not begun."""
        if self.drawn_scene:
            world.reset(scene=self.drawn_scene.values)

    def control(self, world: World) -> Callable[[], npt.NDArray[np.float64] | None]:
        """The controls of the next tick; None: those of the scene's own source."""
        if self.tracks:
            source = control_of(self.tracks, world.model, self.config.seed)
            return lambda: np.asarray(
                source(world.tick * self.tick_us * 1e-6, world.data), np.float64
            )
        if self.rows is not None:
            rows, periods = self.rows, self.config.scene.control_hz * self.tick_us / 1e6
            return lambda: rows[min(math.floor(world.tick * periods + 1e-9), len(rows) - 1)]
        return lambda: None

    def world_at_begin(self, config: RunConfig) -> World:
        """The world with its camera at `begin`, when the camera has settled."""
        first_look = self.begin - self.settle
        if not first_look:
            world = World.from_config(config)
            self.randomise(world)
            control = self.control(world)
        elif config.scene.camera and config.camera != CameraConfig():
            raise EvsError(
                "a camera of the model with another lens cannot begin later: "
                f"begin_s={self.settle * self.tick_us * 1e-6:g}"
            )
        else:
            world = World(config.scene, seed=config.seed, threads=config.threads)
            self.randomise(world)
            control = self.control(world)
            while world.tick < first_look:
                world.step(control())
            world.add_camera(
                config.scene.camera or config.camera,
                sensor=config.sensor,
                render=config.render,
                model=config.model,
                name=config.name,
            )
        while world.tick < self.begin:
            world.step(control())
        return world

    def view_at(self, config: RunConfig, tick: int) -> tuple[World, View]:
        """The world at a tick, and a view in colour with the samples of the frames."""
        # colour is rendered on the CPU
        render = replace(config.render, spp=self.frames.spp, device="cpu")
        world, view = World.with_view(replace(config, render=render), rgb=True)
        self.randomise(world)
        control = self.control(world)
        while world.tick < tick:
            world.step(control())
        return world, view

    def frame_ticks(self) -> list[int]:
        """The ticks of the frames: the first tick, then every 1 / fps; the end has none."""
        count = math.ceil((self.end - self.begin) * self.tick_us * self.frames.fps / 1e6 - 1e-6)
        at = (round(one * 1e6 / self.frames.fps / self.tick_us) for one in range(count))
        return [self.begin + tick for tick in at if self.begin + tick < self.end]


def make_sequence_specs(name: str, scene: SceneFile) -> list[SequenceSpec]:
    """The specifications of a scene's sequences, one for each episode.

    Raises:
        EvsError: as make_sequence_spec, or a sensor that was drawn is impossible.
    """
    first = make_sequence_spec(name, scene)
    found = []
    names = scene.sequence_names(name)
    draws = zip(names, scene.draw(name), scene.draw_scenes(name), strict=True)
    for episode, (sequence_name, drawn, drawn_scene) in enumerate(draws):
        config = first.config
        control_seed = config.scene.control_seed + episode
        config = replace(
            config,
            seed=config.seed + episode,
            scene=replace(config.scene, control_seed=control_seed),
        )
        if drawn:
            try:
                resolve_sensor(drawn.config)
            except EvsError as error:
                raise EvsError(f"at randomise, sequence {sequence_name}: {error}") from None
            config = replace(config, sensor=drawn.config)
        found.append(
            replace(first, name=sequence_name, config=config, drawn=drawn, drawn_scene=drawn_scene)
        )
    return found


def make_sequence_spec(name: str, scene: SceneFile) -> SequenceSpec:
    """The specification of a scene's first sequence, with the sensor that it has without ranges.

    Raises:
        EvsError: something in it is impossible; nothing has been made.
    """
    model = model_of(scene)
    config = scene.run()
    rows = None
    if config.scene.control == "file":
        rows = read_controls(config.scene.control_file, model.nu)
        plain = replace(config.scene, control="auto", control_file="")
        config = replace(config, scene=plain)
    # whole chunks of a network, so that the recording begins with one
    chunk = max(1, config.model.chunk)  # less is refused below
    settle = math.ceil(scene.settle_s * 1e6 / (config.scene.tick_us * chunk)) * chunk
    begin = max(round(scene.begin_s * 1e6 / config.scene.tick_us), settle)
    ticks = max(1, round(scene.duration_s * 1e6 / config.scene.tick_us))
    config = replace(config, scene=replace(config.scene, file=""))
    sequence = SequenceSpec(
        name,
        name,
        bytes_of(model),
        config,
        scene.motion,
        rows,
        scene.frames,
        settle,
        begin,
        begin + ticks,
    )
    # errors of the emulator are raised here
    with sequence.with_model_file() as placed:
        World.from_config(placed)
        render = replace(placed.render, spp=sequence.frames.spp)
        try:
            World.with_view(replace(placed, render=render))
        except EvsError as reason:
            # the only new value is what the user knows as frames.spp
            raise EvsError(str(reason).replace("render.spp", "frames.spp")) from None
    return sequence
