"""Which antialiasing serves an event camera: events of each against those of 256 samples a pixel.

Robots of gymnasium and dm_control; a camera that stands still, pans at 170 px/s or slides at half
a metre a second. It takes a quarter of an hour, so `make bench` leaves it out; the table of the
README is from `.venv/bin/pytest -m bench -s tests/bench/test_light_antialiasing_study.py`.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SensorConfig
from evs.emulator.light import DirectRenderer
from evs.emulator.metrics import compare
from evs.emulator.scene import CameraPose, SceneSnapshot
from evs.emulator.sensor import make_event_model, resolve_sensor
from evs.emulator.world import Poser, bind_camera, extract_scene
from evs.msgs import Events, join_events

WIDTH, HEIGHT, TICKS = 173, 130, 81
SCENES = ["gymnasium/humanoid", "dm_control/humanoid", "dm_control/cartpole",
          "dm_control/quadruped"]  # fmt: skip
MODES = {
    "fixed 1": RenderConfig(antialiasing="fixed", spp=1),
    "fixed 4": RenderConfig(antialiasing="fixed", spp=4),
    "fixed 16": RenderConfig(antialiasing="fixed", spp=16),
    "adaptive 4": RenderConfig(antialiasing="adaptive", spp=4),
    "adaptive 8": RenderConfig(antialiasing="adaptive", spp=8),
    "adaptive 16": RenderConfig(antialiasing="adaptive", spp=16),
}


def film(path: Path, motion: str):
    """(scene, camera, (snapshot, pose) of each ms) of a robot that random controls move."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    view = CameraConfig(lookat=tuple(model.stat.center), distance=1.5 * model.stat.extent,
                        azimuth=90, elevation=-20)  # fmt: skip
    bound = bind_camera(model, "", WIDTH, HEIGHT, view)
    poser = Poser(model, [bound])
    data.ctrl[:] = np.random.default_rng(1).uniform(-0.4, 0.4, model.nu)
    for _ in range(50):
        mujoco.mj_step(model, data)
    taken: list[tuple[SceneSnapshot, CameraPose]] = []
    for k in range(TICKS):
        snapshot = poser.snapshot(data, 1000 * k)
        rest = snapshot.cameras[0]
        pos, mat = rest.pos, rest.mat.reshape(3, 3)
        if motion == "pan":
            angle = 0.170 * k / bound.model.fx
            cos, sin = np.cos(angle), np.sin(angle)
            mat = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ mat
        if motion == "slide":
            pos = pos + mat[:, 0] * (0.0005 * k)
        taken.append((snapshot, CameraPose(pos, np.ascontiguousarray(mat.reshape(9)))))
        mujoco.mj_step(model, data)
    return extract_scene(model), bound.model, taken


def observe(scene, camera, taken, config: RenderConfig) -> tuple[Events, float]:
    """Events of the `plain` pixel, and the median time of a frame on one thread, ms."""
    renderer = DirectRenderer(scene, camera, config, 1)
    sensor = resolve_sensor(SensorConfig("davis346", width=WIDTH, height=HEIGHT))
    model = make_event_model(sensor, ModelConfig(), 1)
    state, parts, times = model.init(0), [], []
    for snapshot, pose in taken:
        begin = time.perf_counter()
        light = renderer.render(snapshot, pose)
        times.append(1e3 * (time.perf_counter() - begin))
        found, state = model.step(light, state, snapshot.t_us - 1000, snapshot.t_us)
        parts.append(found)
    return join_events(parts), statistics.median(times)


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan", "slide"])
@pytest.mark.parametrize("name", SCENES)
def test_events_of_each_antialiasing(name: str, motion: str, robot_files: dict[str, Path]) -> None:
    scene, camera, taken = film(robot_files[name], motion)
    truth, _ = observe(scene, camera, taken, RenderConfig(antialiasing="fixed", spp=256))
    print(f"\n{name}, {motion}: {len(truth)} events of 256 samples")
    emd = {}
    for mode, config in MODES.items():
        events, ms = observe(scene, camera, taken, config)
        c = compare(events, truth, WIDTH, HEIGHT, 0, 1000 * (TICKS - 1))
        emd[mode] = c.emd
        print(
            f"  {mode:12} EMD {c.emd:8.4f}  recall {c.recall:.3f}  precision {c.precision:.3f}"
            f"  {ms:6.2f} ms"
        )
    if len(truth) > 1000:
        assert emd["adaptive 16"] < emd["fixed 4"]
