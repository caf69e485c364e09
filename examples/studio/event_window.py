"""A plugin for MuJoCo Studio (MuJoCo 4): a window with the events of one of the model's cameras.

    python -m mujoco.studio.viewer --gfx=web --model=robot.xml --plugins=event_window.py

CameraPlugin runs beside the physics and observes every step; EventWindow draws on the viewer's
side. Studio makes both without arguments: change CAMERA and SENSOR below for others.

Studio's web server has no password and listens on every interface of the machine: use it where you
trust the network.
"""

from __future__ import annotations

import dataclasses
from collections import deque

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco.studio import messages, plugin, sim
from mujoco.studio.dear_imgui import dear_imgui as imgui
from mujoco.studio.implot import implot

from evs.drivers.clock import monotonic_s, sleep_s
from evs.emulator import EventCamera
from evs.emulator.config import RenderConfig
from evs.msgs import Events, EvsError, empty_events
from evs.msgs.pictures import OFF_RGB, ON_RGB

CAMERA = ""
"""one of the model's cameras; empty: the first"""
SENSOR = "davis346"
LONGEST_MS = 100
"""length of the longest window"""
UPLOADS_HZ = 15.0
"""Most pictures a second. Studio keeps all that a slow browser has not fetched, 360 kB each."""
BUSY_S = 0.008
"""how long physics and camera may take before the viewer's thread gets its turn"""


@dataclasses.dataclass(frozen=True, eq=False)
class EventsSnapshot(messages.Snapshot):  # type: ignore[misc]
    """From the physics to the viewer; the latest replaces those before."""

    now_us: int
    size: tuple[int, int]
    """width and height, px"""
    events: Events
    """of the last LONGEST_MS"""
    problem: str = ""
    """why there is no camera"""


class CameraPlugin(plugin.SimPlugin):  # type: ignore[misc]
    """Steps the physics in Studio's place, and observes after every step.

    Studio's StepControl makes tens of steps at once, of which a camera would miss all but the last.
    It still makes single steps.
    """

    def __init__(self, camera: str = CAMERA, sensor: str = SENSOR) -> None:
        self._names = camera, sensor
        self._camera: EventCamera | None = None
        self._paused, self._speed = False, 1.0
        self._problem, self._seen_s, self._sent_s = "", 0.0, 0.0
        self._packets: deque[Events] = deque()
        self._began: tuple[float, float] | None = None
        """wall clock and simulated time, s, from which the pace is kept"""

    @messages.handler  # type: ignore[untyped-decorator]
    def on_post_model(self, event: messages.PostModelEvent) -> None:
        """Put the camera into a new model."""
        name, sensor = self._names
        fast = RenderConfig(renderer="direct", spp=1)
        try:
            self._camera = EventCamera(event.model, name, sensor=sensor, render=fast)
            self._problem = ""
        except EvsError as error:
            self._camera, self._problem = None, str(error)
        self._start_over(event.data.time)

    @messages.handler(priority=messages.Priority.CRITICAL)  # type: ignore[untyped-decorator]
    def on_pause(self, event: messages.RequestPauseEvent) -> None:
        """Note the state; Studio's StepControl gets the event, too."""
        self._paused, self._began = event.pause_state != sim.PauseState.UNPAUSED, None

    @messages.handler(priority=messages.Priority.CRITICAL)  # type: ignore[untyped-decorator]
    def on_step_control(self, event: messages.StepControlSnapshot) -> None:
        """Note state and speed; Studio's StepControl gets them, too."""
        self._paused, self._began = event.pause_state != sim.PauseState.UNPAUSED, None
        self._speed = event.speed / 100

    @messages.handler(priority=messages.Priority.CRITICAL)  # type: ignore[untyped-decorator]
    def on_step(self, event: messages.StepEvent) -> bool:
        """Make the steps that are due; return whether Studio must make none."""
        model, data = event.model, event.data
        if self._paused or self._camera is None:
            return False
        wall_s = monotonic_s()
        if self._began is None or data.time < self._seen_s:
            self._began = wall_s, data.time
        due_s = self._began[1] + self._speed * (wall_s - self._began[0])
        while data.time < due_s and monotonic_s() < wall_s + BUSY_S:
            mujoco.mj_step(model, data)
            self._observe(data)
        if due_s - data.time > 0.1:
            self._began = None  # too slow for its speed: time slips
        sleep_s(0.001)
        return True

    @messages.handler  # type: ignore[untyped-decorator]
    def on_post_step(self, event: messages.PostStepEvent) -> None:
        """Observe a single step of Studio's; send what there is, each of which is one upload."""
        if event.data.time != self._seen_s:
            self._observe(event.data)
        wall_s = monotonic_s()
        if wall_s - self._sent_s < 1 / UPLOADS_HZ:
            return
        self._sent_s = wall_s
        now_us = round(self._seen_s * 1e6)
        while self._packets and self._packets[0]["t"][-1] < now_us - LONGEST_MS * 1000:
            self._packets.popleft()
        info = None if self._camera is None else self._camera.info
        size = (1, 1) if info is None else (info.width, info.height)
        events = np.concatenate([empty_events(), *self._packets])
        self.handle.send_to_viewer(EventsSnapshot(now_us, size, events, self._problem))

    def _observe(self, data: mujoco.MjData) -> None:
        if data.time < self._seen_s:
            self._start_over(data.time)
        self._seen_s = data.time
        if self._camera is not None and len(events := self._camera.observe(data)):
            self._packets.append(events)

    def _start_over(self, time_s: float) -> None:
        if self._camera is not None:
            self._camera.reset()
        self._packets.clear()
        self._seen_s, self._began = time_s, None


class EventWindow(plugin.ViewerPlugin):  # type: ignore[misc]
    """The window: picture, length of its time span, and rate."""

    def __init__(self) -> None:
        self._snapshot: EventsSnapshot | None = None
        self._texture, self._is_new = 0, False
        self._span_ms = 20
        self._rates: deque[tuple[float, float]] = deque(maxlen=240)
        """simulated time, s, and million events/s"""

    @messages.handler  # type: ignore[untyped-decorator]
    def on_events(self, event: EventsSnapshot) -> None:
        """Keep what came."""
        self._snapshot, self._is_new = event, True
        recent = np.count_nonzero(event.events["t"] > event.now_us - 1000 * self._span_ms)
        if self._rates and event.now_us * 1e-6 < self._rates[-1][0]:
            self._rates.clear()
        self._rates.append((event.now_us * 1e-6, recent / self._span_ms * 1e-3))

    @messages.handler  # type: ignore[untyped-decorator]
    def on_build_gui(self, _: messages.BuildGuiEvent) -> None:
        """Draw the window."""
        if imgui.Begin("evs"):
            self._draw()
        imgui.End()

    def _draw(self) -> None:
        snapshot = self._snapshot
        if snapshot is None or snapshot.problem:
            imgui.Text("waiting for the first step" if snapshot is None else snapshot.problem)
            return
        width, height = snapshot.size
        if self._is_new:
            self._is_new = False
            picture = picture_of(snapshot, self._span_ms).tobytes()
            self._texture = self.viewer.upload_image(self._texture, picture, width, height, 4)
        if self._texture:
            imgui.Image(self._texture, imgui.Vec2(1.5 * width, 1.5 * height))
        _, self._span_ms = imgui.SliderInt("window (ms)", self._span_ms, 1, LONGEST_MS)
        times, rates = map(list, zip(*self._rates, strict=True))
        imgui.Text(f"t {times[-1]:.3f} s  {rates[-1]:.2f} Mev/s")
        if implot.BeginPlot("event rate (Mev/s)", imgui.Vec2(500, 150)):
            implot.SetupAxes("s", "", 1 << 11, 1 << 11)  # both fit to the data
            implot.PlotLine("rate", times, rates)
            implot.EndPlot()


def picture_of(snapshot: EventsSnapshot, span_ms: int) -> npt.NDArray[np.uint8]:
    """Return (h, w, 4) RGBA: the last event of each pixel in the last `span_ms`."""
    width, height = snapshot.size
    picture = np.full((height, width, 4), (24, 24, 24, 255), np.uint8)
    events = snapshot.events[snapshot.events["t"] > snapshot.now_us - 1000 * span_ms]
    colours = np.array([OFF_RGB, ON_RGB], np.uint8)
    picture[events["y"], events["x"], :3] = colours[events["p"].astype(np.intp)]
    return picture
