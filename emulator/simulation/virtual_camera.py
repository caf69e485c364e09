"""VirtualCamera: the shorthand for one camera in one world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy.typing as npt

from evs.emulator.base.scene import F32, GroundTruth
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.emulator.simulation.world import World
from evs.emulator.world import ControlFunction, Scene, Visual
from evs.msgs import EventPacket, EvsError, Frame, ImuSamples, StreamInfo


class VirtualCamera:
    """A world with one camera: iterate over its packets, without end, or step it.

    for packet in VirtualCamera("humanoid.xml", control="random").run(1.0): ...
    """

    def __init__(
        self,
        scene: Scene | SceneConfig,
        camera: str | CameraConfig = "",
        *,
        tick_us: int = 1000,
        control: str | ControlFunction = "auto",
        sensor: str | SensorConfig = "davis346",
        render: RenderConfig | None = None,
        model: ModelConfig | None = None,
        seed: int = 0,
        threads: int = 0,
        name: str | None = None,
        visual: Visual | None = None,
    ) -> None:
        """Make a world with one camera.

        Args:
            scene: As of World.
            camera: As of World.add_camera.
            tick_us: As of World.
            control: As of World.
            sensor: As of World.add_camera.
            render: As of World.add_camera.
            model: As of World.add_camera.
            seed: As of World.
            threads: As of World.
            name: As of World.add_camera.
            visual: As of World.

        Raises:
            EvsError: As of World and World.add_camera.
        """
        self.world = World(
            scene, tick_us=tick_us, control=control, seed=seed, threads=threads, visual=visual
        )
        if isinstance(scene, SceneConfig) and camera == "":
            camera = scene.camera
        self.camera = self.world.add_camera(
            camera, sensor=sensor, render=render, model=model, name=name
        )

    def __repr__(self) -> str:
        return f"<evs.VirtualCamera '{self.camera.name}' in {self.world!r}>"

    def step(self, ctrl: npt.ArrayLike | None = None) -> EventPacket:
        """Advance by one tick.

        Args:
            ctrl: (nu,) controls, which hold until others are given.

        Returns:
            The packet of the tick.

        Raises:
            EvsError: model.chunk is over 1; then iterate, or use `run`.
            UnstableError: The physics broke down.
        """
        if self.camera.chunk > 1:
            raise EvsError(
                f"model.chunk is {self.camera.chunk}, so a tick has no packet of its own: iterate, "
                "call run, or leave it 1"
            )
        (packet,) = self.world.step(ctrl)
        return packet

    def reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        sensor: str | SensorConfig | None = None,
        scene: Mapping[str, float] | None = None,
    ) -> None:
        """Back to the beginning; see World.reset."""
        self.world.reset(seed, keyframe, sensor, scene)

    def save(self, compress: bool = False) -> bytes:
        """Everything that the next tick follows from; see World.save."""
        return self.world.save(compress)

    def restore(self, blob: bytes) -> None:
        """Go on from where `save` was called; see World.restore."""
        self.world.restore(blob)

    def run(self, duration_s: float) -> Iterator[EventPacket]:
        """The packets of `duration_s` simulated seconds."""
        return (packet for packets in self.world.run(duration_s) for packet in packets)

    def __iter__(self) -> Iterator[EventPacket]:
        while True:
            yield from self.world.step()

    @property
    def luminance(self) -> F32:
        """(h, w) float32 linear luminance of the last tick, a copy."""
        return self.camera.luminance

    def ground_truth(self) -> GroundTruth:
        """Depth, normals, ids, flow, ... of the last tick, computed at each call."""
        return self.camera.ground_truth()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Intensity frames whose read-out ended in the last tick; see Camera.frames."""
        return self.camera.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) IMU samples of the last tick; see Camera.imu."""
        return self.camera.imu

    @property
    def info(self) -> StreamInfo:
        """What is constant of its stream."""
        return self.camera.info
