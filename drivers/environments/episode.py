"""EpisodeSpec: what learners' episodes are made of, as one value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from evs.drivers.run.sensor_ranges import read_ranges, split_ranges
from evs.emulator import Worlds
from evs.emulator.base.package_paths import in_package
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.emulator.config.keywords import named_keywords
from evs.emulator.sensor.randomisation import SensorRanges
from evs.emulator.simulation.scene_ranges import SceneRanges, Start
from evs.emulator.simulation.stacked_arrays import StackedArrays
from evs.emulator.world import ControlFunction, MjModel, Scene, Visual, load_model, resolve_visual
from evs.msgs import EvsError, StreamInfo

Spec = TypeVar("Spec", bound="EpisodeSpec")


@named_keywords
@dataclass(frozen=True, eq=False)
class EpisodeSpec:
    """A scene, the cameras in it, where its episodes begin and how they differ.

    Data sets and environments take these fields as keywords, or an EpisodeSpec in place of the
    scene:

        spec = EpisodeSpec("robot.xml", "wrist", randomise={"pos_thres": "uniform(0.15, 0.4)"})
        dataset = evs.SimulatedDataset(spec, samples=10_000)

    EvsError: a file of ranges cannot be read. Everything else is checked where worlds are made.
    """

    scene: Scene | SceneConfig
    """MJCF or MJB file, `package:path`, MjModel, MjSpec or SceneConfig"""
    cameras: str | CameraConfig | Sequence[str | CameraConfig] = ("",)
    """names of the model's cameras, or descriptions; "" is its first, else a free camera"""
    bins: int = 5
    """of a voxel grid"""
    tau_us: float = 30_000.0
    """time constant of a time surface, us"""
    capacity: int = 2048
    """events that a packet holds"""
    sensor: str | SensorConfig = "davis346"
    """preset or configuration, the same for all cameras"""
    render: RenderConfig | None = None
    """how light reaches the pixels; None: the defaults"""
    model: ModelConfig | None = None
    """what turns light into events; None: the defaults"""
    ticks: int = 50
    """of a step, or of a sample"""
    tick_us: int = 1000
    """length of a tick, us"""
    start: Start | None = None
    """name of a joint -> range of its position at the start; or f(random, data)"""
    keyframe: str = ""
    """the one to start from; "" is as the model says"""
    limits: Mapping[str, tuple[float, float]] | None = None
    """name of a <sensor> -> (low, high); leaving the range ends the episode"""
    randomise: Mapping[str, Any] | str | Path | None = None
    """key of [sensor] -> its range, as in evs.SensorRanges, and under "scene" those of the scene,
    as in evs.SceneRanges; or a TOML file with a table [randomise]: another sensor, the same for all
    cameras, and another scene in each episode"""
    visual: Visual | None = None
    """groups and flags that are seen, a mujoco.MjvOption or a VisualConfig; None: those of a
    SceneConfig, else what MuJoCo shows by default"""

    def __post_init__(self) -> None:
        if isinstance(self.randomise, str | Path):
            ranges = read_ranges(in_package(str(self.randomise)))
            object.__setattr__(self, "randomise", ranges)
        if self.visual is not None:
            # workers of a loader get a copy, and MuJoCo's option has none
            object.__setattr__(self, "visual", resolve_visual(self.visual))

    @classmethod
    def of(cls: type[Spec], scene: Any, cameras: Any, values: Mapping[str, Any]) -> Spec:
        """The spec of a constructor's arguments.

        Args:
            scene: A scene, or a spec.
            cameras: Of a scene.
            values: Fields that are given.

        Raises:
            EvsError: It is another kind of spec.
        """
        if not isinstance(scene, EpisodeSpec):
            return cls(scene, cameras, **values)
        if not isinstance(scene, cls):
            raise EvsError(f"this takes a {cls.__name__}, not an {type(scene).__name__}")
        return replace(scene, **values)

    def loaded(self: Spec) -> Spec:
        """With the model, so that all worlds and processes have the same. Raises EvsError."""
        if isinstance(self.scene, SceneConfig):
            return self
        return replace(self, scene=load_model(self.scene))

    @property
    def all_cameras(self) -> tuple[str | CameraConfig, ...]:
        """The cameras, also if there is one."""
        if isinstance(self.cameras, str | CameraConfig):
            return (self.cameras,)
        return tuple(self.cameras)

    @property
    def sized_sensor(self) -> str | SensorConfig:
        """The sensor of the cameras."""
        return self.sensor

    def sensor_ranges(self) -> SensorRanges | None:
        """What each episode's sensor is drawn from; None: it stays the same. Raises EvsError."""
        ranges, _ = split_ranges(self.randomise)
        return SensorRanges(ranges, self.sized_sensor) if ranges else None

    def scene_ranges(self, model: MjModel, visual: Visual | None) -> SceneRanges | None:
        """What each episode's scene is drawn from; None: it stays the same. Raises EvsError."""
        _, ranges = split_ranges(self.randomise)
        return SceneRanges(ranges, model, visual) if ranges else None

    def make_worlds(
        self,
        count: int,
        *,
        threads: int,
        control: str | ControlFunction = "auto",
        sensors: Iterable[str] | None = None,
    ) -> Worlds:
        """Make worlds with the cameras. The arguments are those of Worlds. Raises EvsError."""
        worlds = Worlds(
            self.scene,
            count,
            tick_us=self.tick_us,
            control=control,
            threads=threads,
            limits=self.limits,
            sensors=sensors,
            visual=self.visual,
        )
        for camera in self.all_cameras:
            worlds.add_camera(
                camera, sensor=self.sized_sensor, render=self.render, model=self.model
            )
        return worlds

    def make_arrays(
        self, kind: str, infos: Iterable[StreamInfo], count: int, threads: int
    ) -> list[StackedArrays]:
        """The arrays of events of each camera in so many worlds. Raises EvsError."""
        return [
            StackedArrays(
                kind,
                count,
                (info.width, info.height),
                bins=self.bins,
                tau_us=self.tau_us,
                capacity=self.capacity,
                threads=threads,
            )
            for info in infos
        ]
