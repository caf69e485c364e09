"""Robots on film: a model that random controls move, and the events of what a camera sees of it.

The camera takes a picture every ms; it stands still, pans, slides or orbits.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import mujoco
import numpy as np

from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import F32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import CameraConfig
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
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
"""Views from close by that show the whole robot."""


ROOM = """<mujoco><statistic center="0 0 .7" extent="2"/>
    <visual><headlight ambient=".2 .2 .2" diffuse="0 0 0" specular="0 0 0"/></visual><asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".7 .6 .5" rgb2=".3 .35 .4"
             width="128" height="128"/>
    <material name="floor" texture="tiles" texrepeat="6 6" reflectance=".1"/>
    <material name="matt" rgba=".8 .4 .3 1" specular="0"/>
    <material name="gloss" rgba=".3 .5 .8 1" specular=".8" shininess=".6"/>
    <material name="lamp" rgba="1 1 .9 1" emission="6"/></asset><worldbody>
    <light type="point" pos="1.5 -1 2.5" attenuation="0 0 1" diffuse="2 2 2" bulbradius=".25"/>
    <geom type="plane" size="4 4 .1" material="floor"/>
    <geom type="sphere" pos="-1 .6 1.6" size=".25" material="lamp"/>
    <geom type="box" pos=".8 .6 .4" size=".3 .3 .4" euler="0 0 30" material="gloss"/>
    <body pos="0 0 1.5"><joint axis="0 1 0" ref="0"/><joint axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 .5 0 -.5" size=".05" material="matt"/>
      <geom type="sphere" pos=".5 0 -.5" size=".18" material="gloss"/></body>
    </worldbody></mujoco>"""
"""A pendulum in soft light: a glowing ball, a bulb, an even sky and one mirror."""


def model_of(name: str, files: dict[str, Path], soft: bool = True) -> mujoco.MjModel:
    """Load the room or a robot.

    Args:
        name: "room", or the name of a robot in `files`.
        files: Name of each robot -> its MJCF file.
        soft: Whether the robot's lamps become bulbs with a radius of a tenth of
            their distance from the centre of the model.
    """
    if name == "room":
        return mujoco.MjModel.from_xml_string(ROOM)
    model = mujoco.MjModel.from_xml_path(str(files[name]))
    if soft:
        away = np.linalg.norm(model.light_pos - model.stat.center, axis=1)
        model.light_bulbradius[:] = 0.1 * away
    return model


class Film:
    """One take: its scene, its camera, and the (snapshot, pose) of each ms."""

    def __init__(
        self,
        model: mujoco.MjModel,
        motion: str,
        width: int,
        height: int,
        ticks: int,
        view: CameraConfig | None = None,
    ) -> None:
        """Film a model.

        Args:
            model: The model; its time step is set to 1 ms.
            motion: How the camera moves: still, pan (170 px/s), slide (0.5 m/s) or orbit (half a
                turn per second around the point that the view looks at).
            width: Width of the picture, px.
            height: Height of the picture, px.
            ticks: The length of the film, ms.
            view: The first view; by default one from which the whole model is seen.
        """
        self.width, self.height, self.ticks = width, height, ticks
        model.opt.timestep = 1e-3
        data = mujoco.MjData(model)
        if view is None:
            view = CameraConfig(lookat=tuple(model.stat.center), distance=1.5 * model.stat.extent,
                                azimuth=90, elevation=-20)  # fmt: skip
        bound = bind_camera(model, "", width, height, view)
        poser = SnapshotTaker(model, [bound])
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
            if motion == "orbit":
                cos, sin = np.cos(0.001 * np.pi * k), np.sin(0.001 * np.pi * k)
                turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
                center = np.asarray(view.lookat or model.stat.center)
                pos, mat = center + turn @ (pos - center), turn @ mat
            self.taken.append((snapshot, CameraPose(pos, np.ascontiguousarray(mat.reshape(9)))))
            mujoco.mj_step(model, data)
        self.scene: SceneModel = extract_scene(model)
        self.camera: CameraModel = bound.model

    def events_by(self, renderer: Renderer) -> tuple[Events, float]:
        """Return the events of the `plain` pixel, and the median time of a frame, ms."""
        light, ms = self.light_by(renderer)
        return self.events_of(light), ms

    def light_by(self, renderer: Renderer) -> tuple[F32, float]:
        """Return luminance (ticks, height, width), and the median time of a frame, ms."""
        light, times = [], []
        for snapshot, pose in self.taken:
            begin = time.perf_counter()
            frame = renderer.render(snapshot, pose)
            times.append(1e3 * (time.perf_counter() - begin))
            light.append(frame.copy())
        return np.stack(light), statistics.median(times)

    def events_of(self, light: F32) -> Events:
        """Return the events of the `plain` pixel.

        Args:
            light: Luminance (ticks, height, width), float32.
        """
        # the thresholds and dark current of a DAVIS346; the light alone is noisy
        sensor = SensorParameters("film", self.width, self.height, 0.2, 0.2, 0.03, dark_lux=0.1)
        model = PlainModel(sensor, 1)
        state, parts = model.init(0), []
        for (snapshot, _), frame in zip(self.taken, light, strict=True):
            found, state = model.step(frame, state, snapshot.t_us - TICK_US, snapshot.t_us)
            parts.append(found)
        return join_events(parts)
