"""The plugin for MuJoCo Studio: alone, and in Studio's own program without a display."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.bus.address import free_address
from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.search_path import search_path
from evs.msgs import make_events
from evs.msgs.pictures import OFF_RGB, ON_RGB

messages = pytest.importorskip("mujoco.studio.messages", reason="MuJoCo 4 has Studio")
sim = pytest.importorskip("mujoco.studio.sim")
event_window = pytest.importorskip("evs.examples.studio.event_window")

FILE = Path(event_window.__file__)
BALL = """
<mujoco><option timestep="0.002"/><worldbody><light pos="0 -1 3"/>
<camera name="eye" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
<geom type="plane" size="2 2 .1"/><body pos="0 0 .5"><joint name="spin" axis="0 1 0"/>
<geom type="box" size=".5 .05 .05"/></body><body pos="0 0 .9"><joint type="slide" axis="0 0 1"/>
<geom size=".1"/></body></worldbody></mujoco>
"""


class Handle:
    """Studio's handle, as the plugin uses it."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def send_to_viewer(self, message: Any) -> None:
        self.sent.append(message)


def plugged(model: mujoco.MjModel, data: mujoco.MjData, camera: str = "") -> Any:
    """A plugin that has a model."""
    one = event_window.CameraPlugin(camera)
    one.handle = Handle()
    one.on_post_model(messages.PostModelEvent(model, data))
    return one


@pytest.fixture
def ball() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[0] = 20
    return model, data


def tick(one: Any, model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """One sync of Studio; whether the plugin made the steps."""
    made = one.on_step(messages.StepEvent(model, data))
    one.on_post_step(messages.PostStepEvent(model, data))
    return bool(made)


def test_it_observes_every_step(ball: tuple[mujoco.MjModel, mujoco.MjData]) -> None:
    model, data = ball
    one = plugged(model, data)
    deadline_s = monotonic_s() + 60
    while data.time < 0.05:
        assert tick(one, model, data)
        assert monotonic_s() < deadline_s
    one._sent_s = 0.0
    one.on_post_step(messages.PostStepEvent(model, data))
    sent = one.handle.sent[-1]
    assert (sent.now_us, sent.size, sent.problem) == (round(1e6 * data.time), (346, 260), "")

    # the same steps beside it
    again = mujoco.MjData(model)
    again.qvel[0] = 20
    render = evs.RenderConfig(renderer="direct", spp=1)
    camera = evs.EventCamera(model, sensor="davis346", render=render)
    wanted = []
    while again.time < data.time - 1e-9:
        mujoco.mj_step(model, again)
        wanted.append(camera.observe(again))
    np.testing.assert_array_equal(sent.events, np.concatenate(wanted))
    assert len(sent.events) > 1000


def test_pause_single_steps_and_reset(ball: tuple[mujoco.MjModel, mujoco.MjData]) -> None:
    model, data = ball
    one = plugged(model, data)
    while data.time < 0.01:
        tick(one, model, data)
    one.on_pause(messages.RequestPauseEvent(sim.PauseState.NORMAL_PAUSED))
    before_s = data.time
    assert not tick(one, model, data)
    assert data.time == before_s
    # Studio makes a single step; the camera sees it
    mujoco.mj_step(model, data)
    one._sent_s = 0.0
    assert not tick(one, model, data)
    assert one.handle.sent[-1].now_us == round(1e6 * data.time)
    assert one.handle.sent[-1].events["t"][-1] > 1e6 * before_s
    # the speed is Studio's
    one.on_step_control(messages.StepControlSnapshot(sim.PauseState.UNPAUSED, speed=50.0))
    assert tick(one, model, data) is True
    mujoco.mj_resetData(model, data)
    one._sent_s = 0.0
    tick(one, model, data)
    assert one.handle.sent[-1].now_us < 1e6 * before_s
    assert len(one.handle.sent[-1].events) == 0


def test_a_model_without_a_camera_is_one_line_in_the_window() -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    one = plugged(model, data, "ear")
    assert not tick(one, model, data)
    assert "no camera 'ear'" in one.handle.sent[-1].problem


def test_the_picture_shows_the_last_event_of_each_pixel() -> None:
    events = make_events([100, 30_000, 40_000], [1, 2, 2], [0, 1, 1], [1, 1, 0])
    snapshot = event_window.EventsSnapshot(45_000, (4, 3), events)
    picture = event_window.picture_of(snapshot, 20)
    assert picture.shape == (3, 4, 4)
    assert tuple(picture[1, 2]) == (*OFF_RGB, 255)
    # the first is too old
    assert (picture.reshape(-1, 4)[:, :3] != 24).any(axis=1).sum() == 1
    assert tuple(event_window.picture_of(snapshot, 100)[0, 1]) == (*ON_RGB, 255)


PROBE = """
import json, time
from mujoco.studio import messages, plugin

class Probe(plugin.ViewerPlugin):
    '''Writes down what the event window uploads, and when.'''

    def __init__(self):
        self.found = []

    @messages.handler
    def on_viewer(self, event: plugin.ViewerInitEvent) -> None:
        upload = event.viewer.upload_image

        def noted(texture, picture, width, height, planes):
            made = upload(texture, picture, width, height, planes)
            dark = picture.count(bytes((24, 24, 24, 255)))
            self.found.append((time.monotonic(), made, width, height, len(picture), dark))
            with open(%r, "w") as file:
                json.dump(self.found, file)
            return made

        event.viewer.upload_image = noted
"""


@pytest.mark.integration
def test_it_runs_in_studio_without_a_display(tmp_path: Path) -> None:
    """The window is drawn and its pictures are uploaded, at most UPLOADS_HZ times a second."""
    (tmp_path / "ball.xml").write_text(BALL.replace('joint name="spin"', 'joint damping="0"'))
    found = tmp_path / "found.json"
    (tmp_path / "probe.py").write_text(PROBE % str(found))
    port = free_address().rpartition(":")[2]
    words = [
        *("-m", "mujoco.studio.viewer", "--gfx=web", f"--port={port}"),
        f"--model={tmp_path / 'ball.xml'}",
        f"--plugins={tmp_path / 'probe.py'},{FILE}",
    ]
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    log = tmp_path / "log"
    with log.open("w") as output:
        studio = subprocess.Popen(
            [sys.executable, *words], env=environment, stdout=output, stderr=output
        )
    try:
        deadline_s = monotonic_s() + 60
        while len(uploads := read(found)) < 40:
            assert studio.poll() is None, log.read_text()
            assert monotonic_s() < deadline_s, log.read_text()
            sleep_s(0.2)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=20) as page:
            assert page.status == 200
    finally:
        studio.send_signal(signal.SIGINT)
        studio.wait(20)
    assert re.search(r"error|Traceback", log.read_text()) is None, log.read_text()
    times, textures, *shape, dark = (list(column) for column in zip(*uploads, strict=True))
    assert shape == [[346] * len(uploads), [260] * len(uploads), [4 * 346 * 260] * len(uploads)]
    # one texture, written again and again
    assert len(set(textures[1:])) == 1
    assert textures[0] != 0
    # the falling ball has left events in some of them
    assert min(dark) < 346 * 260 - 50
    assert (len(times) - 1) / (times[-1] - times[0]) < 1.05 * event_window.UPLOADS_HZ


def read(found: Path) -> list[list[Any]]:
    """The notes so far; none while they are written."""
    try:
        return list(json.loads(found.read_text()))
    except (FileNotFoundError, json.JSONDecodeError):
        return []
