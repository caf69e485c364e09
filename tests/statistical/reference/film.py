"""Robots on film: a model that random controls move, seen ms by ms by a camera that stands, pans or
slides, and the events that a renderer's light makes of it."""

from __future__ import annotations

import statistics
import time

import mujoco
import numpy as np

from evs.emulator.config import CameraConfig, ModelConfig, SensorConfig
from evs.emulator.metrics import compare
from evs.emulator.metrics.compare import Comparison
from evs.emulator.scene import F32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.sensor import make_event_model, resolve_sensor
from evs.emulator.stages import Renderer
from evs.emulator.world import Poser, bind_camera, extract_scene
from evs.msgs import Events, join_events

TICK_US = 1000
VIEWS = {
    name: CameraConfig(lookat=(0, 0, height), distance=3, azimuth=90, elevation=-20)
    for name, height in {
        "gymnasium/humanoid": 0.9,
        "dm_control/humanoid": 0.9,
        "dm_control/cartpole": 1.3,
        "dm_control/quadruped": 0.4,
    }.items()
}
"""From near by, each robot whole."""


class Film:
    """One take: its scene, its camera, and (snapshot, pose) of each ms."""

    def __init__(
        self,
        model: mujoco.MjModel,
        motion: str,
        width: int,
        height: int,
        ticks: int,
        view: CameraConfig | None = None,
    ) -> None:
        """In: motion, still, pan (170 px/s) or slide (0.5 m/s); view, where from, if not from a
        distance at which the whole model is seen."""
        self.width, self.height, self.ticks = width, height, ticks
        model.opt.timestep = 1e-3
        data = mujoco.MjData(model)
        if view is None:
            view = CameraConfig(lookat=tuple(model.stat.center), distance=1.5 * model.stat.extent,
                                azimuth=90, elevation=-20)  # fmt: skip
        bound = bind_camera(model, "", width, height, view)
        poser = Poser(model, [bound])
        data.ctrl[:] = np.random.default_rng(1).uniform(-0.4, 0.4, model.nu)
        for _ in range(50):
            mujoco.mj_step(model, data)
        self.taken: list[tuple[SceneSnapshot, CameraPose]] = []
        for k in range(ticks):
            snapshot = poser.snapshot(data, TICK_US * k)
            rest = snapshot.cameras[0]
            pos, mat = rest.pos, rest.mat.reshape(3, 3)
            if motion == "pan":
                angle = 0.170 * k / bound.model.fx
                cos, sin = np.cos(angle), np.sin(angle)
                mat = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ mat
            if motion == "slide":
                pos = pos + mat[:, 0] * (0.0005 * k)
            self.taken.append((snapshot, CameraPose(pos, np.ascontiguousarray(mat.reshape(9)))))
            mujoco.mj_step(model, data)
        self.scene: SceneModel = extract_scene(model)
        self.camera: CameraModel = bound.model

    def events_by(self, renderer: Renderer) -> tuple[Events, float]:
        """Events of the `plain` pixel, and the median time of a frame, ms."""
        light, ms = self.light_by(renderer)
        return self.events_of(light), ms

    def light_by(self, renderer: Renderer) -> tuple[F32, float]:
        """(ticks, height, width) luminance, and the median time of a frame, ms."""
        light, times = [], []
        for snapshot, pose in self.taken:
            begin = time.perf_counter()
            frame = renderer.render(snapshot, pose)
            times.append(1e3 * (time.perf_counter() - begin))
            light.append(frame.copy())
        return np.stack(light), statistics.median(times)

    def events_of(self, light: F32) -> Events:
        """Events of the `plain` pixel. In: light (ticks, height, width)."""
        sensor = resolve_sensor(SensorConfig("davis346", width=self.width, height=self.height))
        model = make_event_model(sensor, ModelConfig(), 1)
        state, parts = model.init(0), []
        for (snapshot, _), frame in zip(self.taken, light, strict=True):
            found, state = model.step(frame, state, snapshot.t_us - TICK_US, snapshot.t_us)
            parts.append(found)
        return join_events(parts)

    def compare(self, events: Events, truth: Events, begin_us: int = 0) -> Comparison:
        """How close two streams of this film are, from begin_us on."""
        end_us = TICK_US * (self.ticks - 1)
        return compare(events, truth, self.width, self.height, begin_us, end_us)
