"""The scenes of a data set: those that come with evs, and files of the user."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from evs.drivers.run.sensor_ranges import split_ranges
from evs.emulator.base.package_paths import beside, in_package
from evs.emulator.config import ModelConfig, RenderConfig, RunConfig, SensorConfig, decoding
from evs.emulator.sensor import resolve_sensor
from evs.emulator.sensor.randomisation import DrawnSensor, SensorRanges
from evs.emulator.simulation.scene_ranges import DrawnScene, SceneRanges
from evs.emulator.world import MjModel, load_model
from evs.msgs import EvsError, nearest_first
from evs.tools.dataset.motion import Track, control_of

FOLDER = Path(__file__).parents[2] / "config" / "scenes" / "dataset"
"""NAME.xml and NAME.toml of each scene that comes with evs"""

PLACES = ("indoor", "outdoor", "night")
MOST_SECONDS = 3600.0
MOST_EPISODES = 10_000

Overrides = Iterable[tuple[str, str]]
"""(dotted key, text) of the command line"""


@dataclass(frozen=True)
class FramesConfig:
    """[frames]: pictures with their ground truth."""

    fps: float = 60.0
    """frames per simulated second, each at the nearest tick"""
    spp: int | None = None
    """samples per pixel of their light; None: 256, or 64, its maximum, with the renderer direct"""


@dataclass(frozen=True)
class SceneFile(RunConfig):
    """A scene of a data set: the tables of a pipeline, motion, place, and how it is recorded."""

    render: RenderConfig = field(default_factory=lambda: RenderConfig(renderer="path"))
    model: ModelConfig = field(default_factory=lambda: ModelConfig(labels=True))
    about: str = ""
    """one line"""
    place: str = ""
    """indoor | outdoor | night"""
    begin_s: float = 0.0
    """where in the scene's time the recording begins; no earlier than `settle_s`"""
    settle_s: float = 0.25
    """how long the camera has watched the scene by then, what it saw thrown away: a camera that
    has just been switched on to things that move has more ON events than OFF where it is dark"""
    frames: FramesConfig = field(default_factory=FramesConfig)
    motion: tuple[Track, ...] = ()
    episodes: int = 1
    """how often the scene is recorded: each time with another seed, and so with other noise, other
    motion where it is random, and another sensor and scene where `randomise` has ranges"""
    randomise: Mapping[str, str] = field(default_factory=dict)
    """ranges of the sensor: key of [sensor] -> uniform(low, high), log_uniform(low, high),
    normal(mean, deviation) or choice(a, b, ...); and of the scene, behind `scene.`"""

    def sequence_names(self, name: str) -> tuple[str, ...]:
        """Names of the sequences of a scene of this name: its own, or one for each episode."""
        if self.episodes == 1:
            return (name,)
        return tuple(f"{name}-{episode:04d}" for episode in range(self.episodes))

    def draw(self, name: str) -> list[DrawnSensor | None]:
        """The sensor of each episode, which does not depend on other scenes; None: no ranges.

        Raises:
            EvsError: a range makes no sense.
        """
        sensor, _ = split_ranges(self.randomise)
        if not sensor:
            return [None] * self.episodes
        ranges = SensorRanges(sensor, SensorConfig(**vars(self.sensor)))
        return [ranges.draw(self._seed_of(name), episode) for episode in range(self.episodes)]

    def draw_scenes(self, name: str) -> list[DrawnScene | None]:
        """The values of the scene in each episode; None: no ranges.

        Raises:
            EvsError: a range makes no sense.
        """
        _, scene = split_ranges(self.randomise)
        if not scene:
            return [None] * self.episodes
        ranges = SceneRanges(scene, model_of(self), self.scene.visual)
        return [ranges.draw(self._seed_of(name), episode) for episode in range(self.episodes)]

    def _seed_of(self, name: str) -> int:
        # every scene has other sensors; a double holds the number, as in JSON
        return (zlib.crc32(name.encode()) << 20) + self.seed

    def run(self) -> RunConfig:
        """The part that shapes the events."""
        return RunConfig(**{one.name: getattr(self, one.name) for one in fields(RunConfig)})


def names() -> tuple[str, ...]:
    """The scenes that come with evs."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def named(name: str, overrides: Overrides = ()) -> SceneFile:
    """A scene that comes with evs.

    Args:
        name: of the scene.
        overrides: (dotted key, text) of the command line.

    Raises:
        EvsError: there is no such scene, or a key is wrong.
    """
    if name not in names():
        known = ", ".join(nearest_first(name, names()))
        raise EvsError(f"no scene '{name}' in the set; it has: {known} (another one: --scene FILE)")
    path = FOLDER / f"{name}.toml"
    try:
        tables = _with_defaults(decoding.read_toml(path))
        scene = decoding.build(SceneFile, tables, lambda text: in_package(beside(path, text)))
    except EvsError as error:
        raise EvsError(f"{path}: {error}") from None
    scene = replace(scene, scene=replace(scene.scene, file=str(FOLDER / f"{name}.xml")), name=name)
    return _finished(scene, overrides)


def of_file(file: str, name: str, overrides: Overrides = ()) -> SceneFile:
    """A scene of the user, whose actuators move at random by default.

    If FILE.toml exists next to FILE.xml, it is read like those of the set.

    Args:
        file: that MuJoCo reads.
        name: of the scene.
        overrides: (dotted key, text) of the command line.

    Raises:
        EvsError: a key is wrong.
    """
    path = Path(file)
    toml_file = path.with_suffix(".toml")
    tables = decoding.read_toml(toml_file) if toml_file.is_file() else {}
    try:
        scene = decoding.build(
            SceneFile, _with_defaults(tables), lambda text: in_package(beside(toml_file, text))
        )
    except EvsError as error:
        raise EvsError(f"{toml_file}: {error}") from None
    if "control" not in tables.get("scene", {}) and not scene.motion:
        scene = replace(scene, scene=replace(scene.scene, control="random"))
    scene = replace(scene, scene=replace(scene.scene, file=file), name=name)
    return _finished(scene, overrides)


def _with_defaults(tables: dict[str, object]) -> dict[str, object]:
    """The tables with the defaults of a data set: labels, an IMU, and the renderer path."""
    wanted: dict[str, dict[str, object]] = {
        "render": {"renderer": "path"},
        "model": {"labels": True},
        "sensor": {"imu": {"enabled": True}},
    }
    made = dict(tables)
    for table, keys in wanted.items():
        own_keys = made.get(table, {})
        made[table] = {**keys, **own_keys} if isinstance(own_keys, dict) else own_keys
    return made


def _finished(scene: SceneFile, overrides: Overrides) -> SceneFile:
    scene = decoding.override(scene, overrides, in_package)
    if scene.frames.spp is None:
        spp = 256 if scene.render.renderer == "path" else 64
        scene = replace(scene, frames=replace(scene.frames, spp=spp))
    check(scene)
    return scene


def check(scene: SceneFile) -> None:
    """Check what no stage of the emulator checks.

    Raises:
        EvsError: a value is wrong; the message names its key.
    """
    tick_us = scene.scene.tick_us
    if scene.place and scene.place not in PLACES:
        raise EvsError(f"at place: '{scene.place}' is none of {', '.join(PLACES)}")
    for key in ("duration_s", "begin_s", "settle_s"):
        value = getattr(scene, key)
        least = tick_us * 1e-6 if key == "duration_s" else 0.0
        if not (math.isfinite(value) and least <= value <= MOST_SECONDS):
            raise EvsError(f"at {key}: {value:g} s; give {least:g} ... {MOST_SECONDS:g}")
    if not 1 <= scene.episodes <= MOST_EPISODES:
        raise EvsError(f"at episodes: {scene.episodes}; give 1 ... {MOST_EPISODES}")
    SensorRanges(split_ranges(scene.randomise)[0], SensorConfig(**vars(scene.sensor)))
    if not 0 < scene.frames.fps <= 1e6 / tick_us:
        raise EvsError(
            f"at frames.fps: {scene.frames.fps:g}; give more than 0, at most the "
            f"{1e6 / tick_us:g} ticks of a second"
        )
    if scene.model.name != "plain" and scene.model.labels:
        # another model knows the geoms, but not the causes
        return
    resolve_sensor(SensorConfig(**vars(scene.sensor)))


def model_of(scene: SceneFile) -> MjModel:
    """The model of a scene.

    Raises:
        EvsError: the file does not exist, or a track moves no actuator of it.
    """
    model = load_model(scene.scene.file)
    if scene.motion:
        control_of(scene.motion, model, scene.seed)
    return model
