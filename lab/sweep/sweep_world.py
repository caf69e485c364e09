"""The worlds that are timed: SweepWorld moves as errors do, SegmentedWorld runs in segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from evs.drivers.clock import StopWatch
from evs.drivers.run.config import PipelineConfig
from evs.emulator.base.protocols import Meter, NoMeter
from evs.emulator.base.scene import F32, CameraPose, SceneSnapshot
from evs.emulator.camera.camera import Camera
from evs.emulator.camera.pixel_pipeline import DoneTick, PixelPipeline
from evs.emulator.config import ModelConfig, RunConfig
from evs.emulator.sensor import SensorParameters
from evs.emulator.simulation.pipelined import PipelinedWorld
from evs.emulator.simulation.world import World
from evs.emulator.world import make_control
from evs.msgs import EventPacket, join_events
from evs_lab.evaluation.clip import CONTROL_SCALE, TICK_US, camera_motion
from evs_lab.evaluation.scenes import SceneSetup
from evs_lab.sweep.frame_methods import FrameMethod, interpolate, quantise


def _at_rest(rest: CameraPose, _t_us: int) -> CameraPose:
    return rest


class SweepWorld(World):
    """A World with one camera that moves as in `evs evaluate`; its scene is already in motion."""

    def __init__(
        self,
        setup: SceneSetup,
        motion: str,
        config: PipelineConfig,
        seed: int = 0,
        method: FrameMethod | None = None,
        meter: Meter | None = None,
    ) -> None:
        """Set the scene in motion and add the camera.

        Args:
            setup: the scene.
            motion: of the camera.
            config: of the pipeline.
            seed: of the controls, the same as of errors.
            method: None: events from light; else the camera makes events from frames.
            meter: times the stages.
        """
        tick_us = config.scene.tick_us
        control = make_control(setup.model, "random", seed=seed, scale=CONTROL_SCALE)
        self._method = method
        self._rest: CameraPose | None = None
        self._begin_us: int | None = None
        self._stands = setup.stands
        self._moved: Callable[[CameraPose, int], CameraPose] = _at_rest
        super().__init__(
            setup.model,
            tick_us=tick_us,
            control=lambda t_s, data: control(round(1e6 * t_s), data),
            seed=config.seed,
            threads=config.threads,
            meter=meter or NoMeter(),
        )
        if setup.keyframe:
            self.reset(keyframe=setup.keyframe)
        # before a camera is added, so that nothing is traced
        for _ in range(-(-setup.warm_ticks * TICK_US // tick_us)):
            self.step()
        camera = self.add_camera(
            setup.camera or setup.view,
            sensor=config.sensor,
            render=dataclasses.replace(
                config.render, bounces=setup.bounces, flicker=setup.flicker, sky=setup.sky
            ),
            model=config.model,
            name=config.name,
        )
        self._moved = camera_motion(motion, camera.bound.model)

    def _add(self, config: RunConfig, name: str | None, **given: Any) -> Camera:
        if self._method is None:
            return super()._add(config, name, **given)
        camera = FramesCamera(
            self._method, self.model, self._scene.scene, config, name, meter=self._meter
        )
        self._pose(camera.bound)
        self._cameras.append(camera)
        return camera

    def _snapshot(self) -> SceneSnapshot:
        snapshot = super()._snapshot()
        if not snapshot.cameras:
            return snapshot
        if self._begin_us is None:
            self._begin_us, self._rest = snapshot.t_us, snapshot.cameras[0]
        rest = self._rest if self._stands and self._rest is not None else snapshot.cameras[0]
        pose = self._moved(rest, snapshot.t_us - self._begin_us)
        return dataclasses.replace(snapshot, cameras=(pose,))


class FramesCamera(Camera):
    """A camera whose pixels see frames, as those of v2e and ESIM do."""

    def __init__(self, method: FrameMethod, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        config = self.config
        self._pixels = FramesPixels(method, self.sensor, config.model, config.seed, config.threads)
        self.reset()


class FramesPixels(PixelPipeline):
    """Each tick is a frame; the pictures between the last frame and it come first."""

    def __init__(
        self,
        method: FrameMethod,
        sensor: SensorParameters,
        model: ModelConfig,
        seed: int,
        threads: int,
    ) -> None:
        self._method = method
        self._before: F32 | None = None
        super().__init__(sensor, model, seed, threads)

    def reset(self, seed: int | None = None) -> None:
        """Return to the initial state."""
        self._before = None
        super().reset(seed)

    def see(self, luminance: F32, begin_us: int, end_us: int) -> list[DoneTick]:
        """One frame; all its events are of one tick."""
        shown = quantise(luminance, self._method.code)
        before, self._before = self._before, shown.copy()
        if before is None or not self._method.upsampled:
            return super().see(shown, begin_us, end_us)
        parts = []
        since_us = begin_us
        for t_us, picture in interpolate(before, shown, begin_us, end_us):
            parts += super().see(picture, since_us, t_us)
            since_us = t_us
        return [DoneTick(begin_us, end_us, join_events([part.events for part in parts]))]


class SegmentedWorld:
    """Replaces a world in a run loop; between two segments no thread works.

    Light is rendered ahead within a segment, never across its end, so that something else can be
    timed between segments.
    """

    def __init__(self, world: World, ticks: int, watch: StopWatch, depth: int) -> None:
        """Wrap a world.

        Args:
            world: the world that runs.
            ticks: length of a segment.
            watch: times the stages.
            depth: number of ticks that light is rendered ahead; 0: none.
        """
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
        """The packets of an incomplete chunk."""
        return self._now.finish()

    def close(self) -> None:
        """Stop the thread that renders ahead."""
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
