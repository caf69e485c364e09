"""Rerun's viewer and its .rrd files. The only door to rerun, which comes with the extra `view`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections import deque
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from evs.drivers.files.paths import target_error
from evs.drivers.sink import Stream
from evs.drivers.viewer.time_windows import NOTHING, OFF, ON, Window
from evs.msgs import EventPacket, Events, EvsError, Frame, Pose, StreamInfo
from evs.msgs.pictures import OFF_RGB, ON_RGB, PAPER

SPAN_US = 200_000
"""How far back a cloud reaches, simulated time."""


class EventCloud:
    """Gathers one camera's events; a cloud has `most` points at most, evenly thinned."""

    def __init__(self, most: int) -> None:
        """Start empty; `most` is 1 or more."""
        self._most = most
        self._parts: deque[Events] = deque()

    def add(self, events: Events) -> None:
        """Add a packet's events. A step back in time (a new run) starts over."""
        if not len(events):
            return
        if self._parts and events["t"][0] < self._parts[-1]["t"][-1]:
            self._parts.clear()
        # a copy: the memory of a packet may be used again
        self._parts.append(_thinned(events, self._most).copy())
        # a window may end before the packet that completes it
        while self._parts[0]["t"][-1] <= events["t"][-1] - 2 * SPAN_US:
            self._parts.popleft()

    def points(self, end_us: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """Return the events of (end_us - SPAN_US, end_us].

        Args:
            end_us: Simulated time, us.

        Returns:
            (n, 3) float32: x, px; y, px; age, ms, which is 0 at the end. (n,) bool: ON.
        """
        parts = [
            part[(part["t"] > end_us - SPAN_US) & (part["t"] <= end_us)] for part in self._parts
        ]
        count = sum(map(len, parts))
        places = np.zeros((0, 3), np.float32)
        if not count:
            return places, np.zeros(0, np.bool_)
        events = _thinned(np.concatenate(parts), self._most)
        age_ms = 1e-3 * (end_us - events["t"])
        places = np.stack([events["x"], events["y"], age_ms], axis=1).astype(np.float32)
        return places, events["p"].astype(np.bool_)


def _thinned(events: Events, most: int) -> Events:
    """At most this number of points, evenly chosen, the newest included."""
    if len(events) <= most:
        return events
    return events[np.arange(1, most + 1) * len(events) // most - 1]


APPLICATION = "evs"
TIMELINE = "sim_time"
"""Simulated time; nothing carries the time of the wall clock."""

PROGRAM = (sys.executable, "-P", "-m", "rerun")
"""The viewer and its tools, which the package contains."""


def need_viewer() -> Any:
    """The rerun module; EvsError with the fix where it is not installed."""
    try:
        import rerun
    except ImportError:
        raise EvsError("Rerun is not installed: pip install 'evs[view]'") from None
    return rerun


class RerunDrawing:
    """A stream of pictures for the viewer, into a file or to a running one.

    Under each camera's name: events (by pixel: none, OFF, ON), rate/on and rate/off (events per
    simulated second), luminance, frames, pose; all on the timeline of simulated time. With points,
    also cloud: the events of the last SPAN_US at x px, y px, age ms.
    """

    def __init__(self, points: int = 0) -> None:
        """Make one without a destination; `points` is the most of a cloud, 0 for none."""
        if points < 0:
            raise EvsError(f"points is {points}: give 0 (no cloud) or more")
        self._rerun = need_viewer()
        self._points = points
        self._clouds: dict[str, EventCloud] = {}
        self._stream = self._rerun.RecordingStream(APPLICATION, send_properties=False)
        # no wall-clock times, neither of the file nor of what is drawn
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._spool: Spool | None = None

    def to_file(self, path: Path) -> None:
        """Write a .rrd file. EvsError: it cannot be created."""
        try:
            self._spool = Spool(path)
        except OSError as reason:
            raise target_error(path, reason) from None
        try:
            self._stream.save(self._spool.inlet)
        finally:
            self._spool.begun()

    @property
    def failure(self) -> str:
        """Why writing the file stopped; empty if it did not."""
        return "" if self._spool is None else self._spool.failure

    def to_viewer(self, port: int) -> None:
        """Send to the viewer that listens on this machine."""
        self._stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")

    def describe(self, streams: list[StreamInfo]) -> None:
        """What is constant: colours of the events, optics, names of the curves."""
        rerun = self._rerun
        for stream in streams:
            root = stream.camera
            labels = [
                (NOTHING, "nothing", (PAPER, PAPER, PAPER)),
                (OFF, "OFF", OFF_RGB),
                (ON, "ON", ON_RGB),
            ]
            self._stream.log(f"{root}/events", rerun.AnnotationContext(labels), static=True)
            for name, colour in (("on", ON_RGB), ("off", OFF_RGB)):
                curve = rerun.SeriesLines(colors=[colour], names=[f"{name.upper()} events/s"])
                self._stream.log(f"{root}/rate/{name}", curve, static=True)
            matrix = stream.camera_info.get("k")
            if matrix:
                optics = rerun.Pinhole(
                    image_from_camera=np.reshape(matrix, (3, 3)),
                    resolution=[stream.width, stream.height],
                )
                self._stream.log(f"{root}/pose", optics, static=True)
            if self._points:
                self._describe_cloud(root)

    def _describe_cloud(self, root: str) -> None:
        """A view of its own: its space is not the world's."""
        if root in self._clouds:
            return
        self._clouds[root] = EventCloud(self._points)
        axes = self._rerun.ViewCoordinates.RIGHT_HAND_Y_DOWN
        self._stream.log(f"{root}/cloud", axes, static=True)
        views = self._rerun.blueprint
        self._stream.send_blueprint(
            views.Blueprint(
                *(
                    views.Spatial3DView(origin=f"{camera}/cloud", name=f"{camera}: x, y, age")
                    for camera in self._clouds
                ),
                auto_views=True,
                auto_layout=True,
            )
        )

    def wants(self, stream: Stream, camera: str) -> bool:  # noqa: ARG002
        """Everything is wanted: a viewer keeps what it gets."""
        return True

    def events(self, packet: EventPacket) -> None:
        """Keep them for the cloud, if there is one."""
        if self._points:
            self._clouds[packet.camera].add(packet.events)

    def window(self, window: Window) -> None:
        """Events, rates and cloud."""
        rerun, root = self._rerun, window.camera
        self._at(window.end_us)
        if self._points:
            places, on = self._clouds[root].points(window.end_us)
            colours = np.array([OFF_RGB, ON_RGB], np.uint8)[on.astype(np.intp)]
            self._stream.log(f"{root}/cloud", rerun.Points3D(places, colors=colours))
        self._stream.log(f"{root}/events", rerun.SegmentationImage(window.picture))
        self._stream.log(f"{root}/rate/on", rerun.Scalars([window.on_hz]))
        self._stream.log(f"{root}/rate/off", rerun.Scalars([window.off_hz]))

    def frame(self, frame: Frame) -> None:
        """An intensity frame, at the end of its exposure."""
        self._at(frame.exposure_end_us)
        self._stream.log(f"{frame.camera}/frames", self._rerun.Image(frame.pixels))

    def luminance(self, camera: str, t_us: int, picture: npt.NDArray[np.uint8]) -> None:
        """The light on the sensor, (h, w), as it is shown."""
        self._at(t_us)
        self._stream.log(f"{camera}/luminance", self._rerun.Image(picture))

    def pose(self, pose: Pose) -> None:
        """The camera's pose in the world."""
        turn = self._rerun.Quaternion(xyzw=list(pose.orientation))
        place = self._rerun.Transform3D(translation=list(pose.position), quaternion=turn)
        self._at(pose.t_us)
        self._stream.log(f"{pose.camera}/pose", place)

    def close(self) -> None:
        """Send everything that waits, and disconnect."""
        self._stream.disconnect()
        if self._spool is not None:
            self._spool.join()

    def _at(self, t_us: int) -> None:
        self._stream.set_time(TIMELINE, duration=np.timedelta64(t_us, "us"))


class ViewerProgram:
    """Rerun's viewer as a program, with telemetry off; the user's configuration is unchanged."""

    def __init__(self, *, web: bool) -> None:
        """Start it, reachable from this machine only.

        Args:
            web: Serve the viewer to a browser, in place of a window.
        """
        need_viewer()
        self.port = _free_port()
        """where it takes data"""
        self.url = ""
        """what a browser opens; empty for a window"""
        self._folder = Path(tempfile.mkdtemp(prefix="evs-view-"))
        words = [*PROGRAM, "--port", str(self.port), "--bind", "127.0.0.1"]
        if web:
            page = _free_port()
            words += ["--serve-web", "--web-viewer-port", str(page)]
            source = quote(f"rerun+http://127.0.0.1:{self.port}/proxy", safe="")
            self.url = f"http://127.0.0.1:{page}/?url={source}"
        else:
            words += ["--hide-welcome-screen"]
        self._process = subprocess.Popen(
            words,
            env=quiet_environment(self._folder),
            # the server logs each connection
            stderr=subprocess.DEVNULL if web else None,
        )

    @property
    def is_running(self) -> bool:
        """Whether it still runs: a user closes a window."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Wait until the user ends it."""
        self._process.wait()

    def close(self) -> None:
        """End it, and remove its folder."""
        # it is a program within a program, which passes on only an interrupt
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)


_PATIENCE_S = 5.0
"""How long an interrupted viewer may take to end."""


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def quiet_environment(folder: Path) -> dict[str, str]:
    """An environment in which Rerun's telemetry is off, by a configuration file in `folder`."""
    place = folder / "rerun"
    place.mkdir(parents=True, exist_ok=True)
    config = place / "analytics.json"
    # if a field is missing, Rerun takes the file as broken and turns its telemetry on
    settings = {
        "analytics_enabled": False,
        "analytics_id": "evs",
        "metadata": {},
        "config_file_path": str(config),
        "data_dir_path": str(place / "analytics"),
    }
    config.write_text(json.dumps(settings))
    return {**os.environ, "XDG_CONFIG_HOME": str(folder), "XDG_DATA_HOME": str(folder)}


_CHUNK_BYTES = 1 << 20


class Spool:
    """A file that Rerun writes through a pipe, so that a full disk does not block it.

    Rerun's own writer blocks for ever where its file cannot grow. Here the rest is discarded, and
    `failure` gives the reason.
    """

    def __init__(self, path: Path) -> None:
        """Create the file. OSError: it cannot be created."""
        self.failure = ""
        """the operating system's message when writing stopped; empty if it did not"""
        self._file = path.open("wb", buffering=0)
        self._outlet, self._inlet = os.pipe()
        self._thread = threading.Thread(target=self._pump, name=f"spool {path.name}", daemon=True)
        self._thread.start()

    @property
    def inlet(self) -> str:
        """The path to open for writing, once, before `begun`."""
        return f"/dev/fd/{self._inlet}"

    def begun(self) -> None:
        """To be called once Rerun has opened `inlet`: the file then ends when Rerun closes it."""
        os.close(self._inlet)

    def join(self) -> None:
        """Wait until everything is written or discarded."""
        self._thread.join()

    def _pump(self) -> None:
        with self._file:
            while data := os.read(self._outlet, _CHUNK_BYTES):
                if self.failure:
                    continue
                rest = memoryview(data)
                try:
                    while rest:
                        rest = rest[self._file.write(rest) :]
                except OSError as reason:
                    self.failure = reason.strerror or str(reason)
        os.close(self._outlet)
