"""A floor without bounds under a sky: it fades into the haze, and behind the haze is the sky."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import F32, CameraPose
from evs.emulator.config import CameraConfig
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.msgs import Events, join_events
from reference.instants import Film

WIDTH, HEIGHT = 24, 144
CAMERA_M, RIM_M, HAZE = 3.0, 0.7 * 50, 0.4
RENDERERS = ("direct", "path")


def view_of(haze: str, more: str = "") -> tuple[mujoco.MjModel, str]:
    """A bright floor, a dark sky, and a camera that looks at the horizon: 20 degrees high."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
        <statistic extent="1"/><visual><headlight active="0"/>
          <map zfar="50" haze="{HAZE}" fogstart="5" fogend="80"/>
          <rgba haze="{haze} 1" fog=".1 .1 .1 1"/></visual>
        <asset><material name="glow" specular="0" emission="1" rgba=".9 .9 .9 1"/>
          <texture type="skybox" builtin="flat" rgb1=".2 .2 .2" rgb2=".2 .2 .2" width="8"
                   height="48"/></asset>
        <worldbody><geom type="plane" size="0 0 .1" material="glow"/>{more}
          <camera name="eye" pos="0 0 {CAMERA_M}" xyaxes="1 0 0 0 0 1" fovy="20"/></worldbody>
        </mujoco>""")
    return model, "eye"


def film(
    model: mujoco.MjModel, camera: str, ticks: int, pitch: float, **render: object
) -> tuple[F32, Renderer]:
    """(ticks, height, width) light of a camera that pitches up and down by so many rad."""
    seen = Film(model, (WIDTH, HEIGHT), CameraConfig(), camera)
    renderer, shot = seen.renderer(**{"spp": None, **render}), seen.shot
    rest, frames = shot.cameras[0], []
    for k in range(ticks):
        angle = pitch * np.sin(2 * np.pi * k / ticks)
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
        pose = CameraPose(rest.pos, np.ascontiguousarray((rest.mat.reshape(3, 3) @ turn).ravel()))
        frames.append(renderer.render(shot, pose).copy())
    return np.stack(frames), renderer


@pytest.mark.parametrize("fog", [False, True], ids=["clear", "fog"])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_light_rises_from_the_sky_to_the_floor_without_a_band(renderer: str, fog: bool) -> None:
    # haze between sky and floor: down a column light can only rise, and never by much at once
    model, camera = view_of(".5 .5 .5")
    light = film(model, camera, 1, 0, renderer=renderer, spp=64, fog=fog)[0][0]
    steps = np.diff(light, axis=0)
    rows = 2 * np.tan(np.deg2rad(10)) / HEIGHT  # slope a row
    # haze goes from none to all over at least the slope between horizon and rim, or rim and plane
    ramp = min(CAMERA_M / RIM_M, CAMERA_M / RIM_M * HAZE / (1 - HAZE))
    most = 1.5 * (light.max() - light.min()) * rows / ramp * (1 + HAZE)
    # in `path` a pixel's 64 points are its own: its mean is not the next one's by some of them
    assert steps.min() > -3 / 64 * most
    assert steps.max() < most
    assert light[-1].min() > 3 * light[0].max()


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_pitching_camera_fires_no_events_at_the_horizon(renderer: str) -> None:
    # haze of the sky's own colour: above the floor's end there is nothing to see
    model, camera = view_of(".2 .2 .2")
    pitch = np.deg2rad(1)
    light, _ = film(model, camera, 60, pitch, renderer=renderer, spp=1)
    end = np.arctan(CAMERA_M / RIM_M) - pitch - np.deg2rad(20) / HEIGHT
    last = int(HEIGHT / 2 + np.tan(end) / np.tan(np.deg2rad(10)) * HEIGHT / 2)
    assert last > HEIGHT / 2 + 20
    events = events_of(light)
    assert (events["y"] < last).sum() == 0
    assert (events["y"] >= last).sum() > 1000


def events_of(light: F32) -> Events:
    sensor = SensorParameters("horizon", WIDTH, HEIGHT, 0.2, 0.2, 0.03)
    model = PlainModel(sensor, 1)
    state, parts = model.init(0), []
    for k, frame in enumerate(light):
        found, state = model.step(frame, state, 1000 * k - 1000, 1000 * k)
        parts.append(found)
    return join_events(parts)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_what_has_bounds_is_seen_beyond_the_haze(renderer: str) -> None:
    # a second plane without bounds ends as the first does; a tower does not
    tower = '<geom type="box" size="1 1 9" pos="0 60 9" rgba="1 1 1 1" material="glow"/>'
    below = '<geom type="plane" size="0 0 .1" pos="0 0 -1" material="glow"/>'
    alone, towered, doubled = (
        film(*view_of(".5 .5 .5", more), 1, 0, renderer=renderer, spp=1)[0][0]
        for more in ("", tower, below)
    )
    middle, top = WIDTH // 2, HEIGHT // 2 - 20
    assert towered[top, middle] > 10 * alone[top, middle]
    np.testing.assert_array_equal(doubled, alone)
