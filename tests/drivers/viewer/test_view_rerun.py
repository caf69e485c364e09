"""Rerun's files and viewer: what a run and a live stream leave in a .rrd, verified by Rerun."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections import Counter
from datetime import timedelta
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

from evs.drivers.bus import Publisher
from evs.drivers.bus.address import free_address
from evs.drivers.run import config as pipeline
from evs.drivers.search_path import search_path
from evs.drivers.sink_config import SinkConfig
from evs.drivers.viewer import ViewSink
from evs.launch import main as program
from evs.launch.support import live_view
from evs.msgs import EventPacket, EvsError, Frame, Pose, StreamInfo
from evs.msgs.pictures import OFF_RGB, ON_RGB
from reference.mjcf import BAR
from reference.streams import random_packet
from tests.support.full_disk import fill

pytestmark = pytest.mark.skipif(
    find_spec("rerun") is None, reason="the extra `view` is not installed"
)

OPTICS = {
    "width": 64,
    "height": 48,
    "distortion_model": "plumb_bob",
    "d": [0.0] * 5,
    "k": [60.0, 0, 32, 0, 60, 24, 0, 0, 1],
    "r": [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
    "p": [60.0, 0, 32, 0, 0, 60, 24, 0, 0, 0, 1, 0],
}
STREAM = StreamInfo(64, 48, camera="eye", frames=True, camera_info=OPTICS)
ROWS = re.compile(r"with (\d+) rows .* - /(\S+) - data columns: \[(\w+)")


def rerun(folder: Path, *words: object) -> str:
    """Rerun's own program, its telemetry off; what it prints."""
    from evs.drivers.viewer.rerun_drawing import PROGRAM, quiet_environment

    done = subprocess.run(
        [*PROGRAM, *map(str, words)],
        env=quiet_environment(folder / "quiet"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def rows(folder: Path, file: Path, whole: bool = True) -> Counter[str]:
    """`ENTITY COMPONENT` -> rows, of a file that Rerun verifies where it should be `whole`."""
    if whole:
        assert "verified without error" in rerun(folder, "rrd", "verify", file)
    found: Counter[str] = Counter()
    for line in rerun(folder, "rrd", "print", file).splitlines():
        match = ROWS.search(line)
        if match:
            found[f"{match[2]} {match[3]}"] += int(match[1])
    return found


def packet(seq: int, camera: str = "eye") -> EventPacket:
    return random_packet(seq, 30, (64, 48), camera)


def frame(seq: int) -> Frame:
    begin = 10_000 * seq
    pixels = np.full((48, 64), seq, np.uint8)
    return Frame(seq, begin, begin, begin + 500, begin + 800, pixels, "eye")


def publish(publisher: Publisher, ticks: int) -> None:
    """Everything that a live view shows, then the end."""
    for seq in range(ticks):
        if seq % 10 == 9:
            publisher.write_frame(frame(seq // 10))
        pose = Pose(seq, 1000 * seq + 1000, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), "eye")
        if publisher.wants_pose("eye"):
            publisher.write_pose(pose)
        publisher.write(packet(seq))
    publisher.close()


def watched(words: list[str], ticks: int = 100) -> int:
    """Run `evs view --live ...` on a publisher of ours; its exit code."""
    address = free_address()
    publisher = Publisher(address, wait_for=1)

    def run() -> None:
        publisher.open([STREAM])
        # frames and poses are subscribed to beside the events
        time.sleep(0.2)
        publish(publisher, ticks)

    publishing = threading.Thread(target=run)
    publishing.start()
    try:
        return program.main(["view", "--live", address, "--timeout", "20", *words])
    finally:
        publishing.join()


@pytest.mark.slow
def test_a_run_leaves_a_file_that_rerun_verifies(tmp_path: Path) -> None:
    (tmp_path / "bar.xml").write_text(BAR.format(speed=40))
    (tmp_path / "p.toml").write_text(
        "duration_s = 0.2\n[scene]\nfile = 'bar.xml'\nkeyframe = 'fast'\n"
        "[sensor]\nwidth = 48\nheight = 36\n[sensor.aps]\nenabled = true\n"
        "[[sink]]\ntype = 'rerun'\nrrd = 'run.rrd'\nperiod_us = 10000\n"
    )
    assert program.main(["emulate", str(tmp_path / "p.toml"), "--quiet"]) == 0
    found = rows(tmp_path, tmp_path / "run.rrd")
    # 0.2 s in pictures of 10 ms
    assert found["camera/events SegmentationImage"] == 20
    assert found["camera/rate/on Scalars"] == found["camera/rate/off Scalars"] == 20
    # the first tick's, and then one in each picture's time
    assert found["camera/luminance Image"] == found["camera/pose Transform3D"] == 21
    # 25 a second, and the last one's read-out ends after the run
    assert found["camera/frames Image"] in (4, 5)
    assert found["camera/events AnnotationContext"] == 1
    assert found["camera/pose Pinhole"] == 1


@pytest.mark.integration
def test_a_live_stream_leaves_a_file_that_rerun_verifies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "live.rrd"
    assert watched(["-o", str(file)], ticks=150) == 0
    assert "packets 150  events 4500" in capsys.readouterr().err
    found = rows(tmp_path, file)
    # seven windows of 20 ms and the rest
    assert found["eye/events SegmentationImage"] == 8
    assert found["eye/rate/on Scalars"] == 8
    assert found["eye/frames Image"] == 15
    assert found["eye/pose Transform3D"] == 150
    # the optics come with the first status, after 100 ms
    assert found["eye/pose Pinhole"] == 1


def clouds(file: Path, camera: str = "eye") -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Simulated time, us -> (n, 3) positions and (n,) colours of a cloud, by Rerun's own reader."""
    try:
        from rerun.chunk import RrdReader
    except ImportError:
        experimental = pytest.importorskip("rerun.experimental")
        RrdReader = experimental.RrdReader  # noqa: N806 - its name before 0.41
    found = {}
    for chunk in RrdReader(file).stream().to_chunks():
        if chunk.entity_path != f"/{camera}/cloud" or chunk.is_static:
            continue
        rows = chunk.to_record_batch().to_pydict()
        (positions,) = (rows[name] for name in rows if name.endswith(":positions"))
        (colours,) = (rows[name] for name in rows if name.endswith(":colors"))
        for t, places, colour in zip(rows["sim_time"], positions, colours, strict=True):
            found[t // timedelta(microseconds=1)] = np.reshape(places, (-1, 3)), np.array(colour)
    return found


def rgba(colour: tuple[int, int, int]) -> int:
    red, green, blue = colour
    return red << 24 | green << 16 | blue << 8 | 255


@pytest.mark.slow
def test_a_cloud_has_the_events_in_x_y_and_time(tmp_path: Path) -> None:
    sink = ViewSink(tmp_path / "a.rrd", points=100_000)
    sink.open([STREAM])
    for seq in range(300):
        sink.write(packet(seq))
    sink.close()
    found = clouds(tmp_path / "a.rrd")
    assert list(found) == [20_000 * k for k in range(1, 16)]
    for end_us in (20_000, 300_000):
        events = np.concatenate([packet(seq).events for seq in range(end_us // 1000)])
        # 200 ms at most
        events = events[events["t"] > end_us - 200_000]
        places, colours = found[end_us]
        np.testing.assert_array_equal(places[:, 0], events["x"])
        np.testing.assert_array_equal(places[:, 1], events["y"])
        np.testing.assert_allclose(places[:, 2], 1e-3 * (end_us - events["t"]), atol=1e-4)
        wanted = np.where(events["p"], rgba(ON_RGB), rgba(OFF_RGB))
        np.testing.assert_array_equal(colours, wanted)


def test_a_cloud_is_thinned_to_its_most_points(tmp_path: Path) -> None:
    sink = ViewSink(tmp_path / "a.rrd", points=50)
    sink.open([STREAM])
    for seq in range(100):
        sink.write(packet(seq))
    sink.close()
    for places, _ in clouds(tmp_path / "a.rrd").values():
        assert len(places) == 50
        # from all of the time, the newest included
        assert places[:, 2].min() < 2
        assert np.all(np.diff(places[:, 2]) <= 0)
    assert places[:, 2].max() > 90


def test_there_is_no_cloud_unless_asked_for(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="points is -1"):
        ViewSink(tmp_path / "a.rrd", points=-1)
    sink = ViewSink(tmp_path / "a.rrd")
    sink.open([STREAM])
    for seq in range(50):
        sink.write(packet(seq))
    sink.close()
    assert clouds(tmp_path / "a.rrd") == {}


def test_a_live_stream_leaves_a_cloud(tmp_path: Path) -> None:
    file = tmp_path / "live.rrd"
    assert watched(["-o", str(file), "--points", "1000"], ticks=60) == 0
    places, _ = clouds(file)[40_000]
    assert len(places) == 1000
    # of 1200: none is seen twice
    assert len(np.unique(places, axis=0)) > 990


PAGE = re.compile(r"open (http://127\.0\.0\.1:(\d+)/\?url=(\S+))")


@pytest.mark.slow
def test_the_viewer_in_a_browser(tmp_path: Path) -> None:
    """Its page is served to this machine alone, and its data reach Rerun's own client."""
    address = free_address()
    publisher = Publisher(address, wait_for=1)
    opening = threading.Thread(target=publisher.open, args=([STREAM],))
    opening.start()
    words = ["-m", "evs.launch.main", "view", "--live", address, "--rerun-web", "--timeout", "60"]
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    viewing = subprocess.Popen(
        [sys.executable, *words], env=environment, stderr=subprocess.PIPE, text=True
    )
    try:
        assert viewing.stderr is not None
        page = PAGE.match(viewing.stderr.readline())
        assert page is not None
        source = unquote(page[3])
        ports = {int(page[2]), urlsplit(source).port}
        opening.join(20)
        publish(publisher, 100)
        # it stays for the browser after the stream's end
        assert "Ctrl-C ends the viewer" in viewing.stderr.readline()
        with urllib.request.urlopen(page[1], timeout=20) as answer:
            assert b"Rerun" in answer.read()
        assert listening(ports) == {"127.0.0.1"}
        saved = tmp_path / "came.rrd"
        save_from(source, saved, tmp_path)
        assert rows(tmp_path, saved, whole=False)["eye/events SegmentationImage"] == 5
        viewing.send_signal(signal.SIGINT)
        assert "packets 100" in viewing.stderr.readline()
        viewing.wait(20)
        # the server is gone with it
        assert listening(ports) == set()
    finally:
        viewing.kill()
        viewing.communicate()


def save_from(source: str, saved: Path, folder: Path) -> None:
    """Rerun's own client takes what a server has, until it is interrupted."""
    from evs.drivers.viewer.rerun_drawing import PROGRAM, quiet_environment

    port = free_address().rpartition(":")[2]
    words = [*PROGRAM, source, "--save", str(saved), "--bind", "127.0.0.1", "--port", port]
    client = subprocess.Popen(
        words, env=quiet_environment(folder / "client"), stderr=subprocess.DEVNULL
    )
    try:
        deadline_s = time.monotonic() + 20
        while not (saved.exists() and saved.stat().st_size > 10_000):
            assert time.monotonic() < deadline_s
            time.sleep(0.1)
        time.sleep(0.5)
        client.send_signal(signal.SIGINT)
        client.wait(20)
    finally:
        client.kill()
        client.wait()


def listening(ports: set[int | None]) -> set[str]:
    """The IPv4 and IPv6 addresses of this machine on which any of the ports listens."""
    hosts = set()
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text(encoding="ascii").splitlines()[1:]:
            host, _, port = line.split()[1].partition(":")
            if line.split()[3] == "0A" and int(port, 16) in ports:
                address = bytes.fromhex(host)
                known = ".".join(str(byte) for byte in reversed(address))
                hosts.add(known if table == "tcp" else host)
    return hosts


@pytest.mark.slow
def test_a_running_viewer_gets_everything(tmp_path: Path) -> None:
    from evs.drivers.viewer import WindowBuilder
    from evs.drivers.viewer.rerun_drawing import PROGRAM, RerunDrawing, quiet_environment

    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    # without a window: what comes is saved instead
    saved = tmp_path / "came.rrd"
    words = [*PROGRAM, "--save", str(saved), "--port", str(port), "--bind", "127.0.0.1"]
    viewer = subprocess.Popen(
        words, env=quiet_environment(tmp_path / "home"), stderr=subprocess.DEVNULL
    )
    try:
        drawing = RerunDrawing()
        drawing.to_viewer(port)
        drawing.describe([STREAM])
        builder = WindowBuilder("eye", 64, 48)
        for seq in range(100):
            for window in builder.add(packet(seq)):
                drawing.window(window)
        drawing.close()
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline and viewer.poll() is None:
            # it ends by itself when its only client has gone, or else is told to
            if saved.exists() and saved.stat().st_size > 10_000:
                time.sleep(0.5)
                viewer.send_signal(2)
                viewer.wait(10)
            time.sleep(0.1)
    finally:
        viewer.kill()
        viewer.wait()
    # a viewer that is interrupted writes no footer
    assert rows(tmp_path, saved, whole=False)["eye/events SegmentationImage"] == 5


@pytest.mark.integration
def test_rerun_sends_nothing_home(tmp_path: Path) -> None:
    sink = ViewSink(tmp_path / "a.rrd")
    sink.open([STREAM])
    sink.close()
    for _ in range(2):
        rerun(tmp_path, "rrd", "verify", tmp_path / "a.rrd")
    quiet = tmp_path / "quiet"
    # its programs would collect what they send in files there
    assert [file.name for file in quiet.rglob("*") if file.is_file()] == ["analytics.json"]


@pytest.mark.integration
def test_the_sink_thins_out_and_takes_nothing_else(tmp_path: Path) -> None:
    sink = ViewSink(tmp_path / "a.rrd", period_us=5000)
    with pytest.raises(EvsError, match="not open"):
        sink.write(packet(0))
    sink.open([STREAM])
    light = [t for t in range(1000, 21_000, 1000) if sink.wants_light("eye", t)]
    assert light == [1000, 5000, 10_000, 15_000, 20_000]
    # a light that is dark, or not a number, is drawn black
    sink.write_light("eye", 1000, np.zeros((48, 64), np.float32))
    sink.write_light("eye", 2000, np.full((48, 64), np.nan, np.float32))
    for seq in range(12):
        sink.write(packet(seq))
    with pytest.raises(EvsError, match="no camera of this view 'ear'; there is: eye"):
        sink.write(packet(13, "ear"))
    said = sink.close()
    assert sink.close() == said
    # two whole windows and the rest
    assert (said["windows"], said["events"]) == (3, 360)
    assert rows(tmp_path, tmp_path / "a.rrd")["eye/luminance Image"] == 2


@pytest.mark.slow
def test_a_full_disk_stops_the_file_and_rerun_shows_what_came_before(tmp_path: Path) -> None:
    file = tmp_path / "a.rrd"
    said = fill("ViewSink", "file", file)
    assert said.startswith(f"writing {file} stopped: File too large; Rerun shows what")
    assert rows(tmp_path, file, whole=False)["eye/events SegmentationImage"] >= 1


def test_what_cannot_be_written_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"does not end in \.rrd"):
        ViewSink(tmp_path / "a.png")
    with pytest.raises(EvsError, match="period_us is 0"):
        ViewSink(tmp_path / "a.rrd", period_us=0)
    with pytest.raises(EvsError, match=r"cannot write .*no/a\.rrd: there is no folder"):
        ViewSink(tmp_path / "no" / "a.rrd").open([STREAM])


def test_without_the_extra_one_line_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(EvsError, match=r"pip install 'evs\[view\]'"):
        pipeline.make_sink(SinkConfig.of(type="rerun", rrd=str(tmp_path / "a.rrd")))
    words = ["view", "--live", "tcp://127.0.0.1:9", "-o", str(tmp_path / "a.rrd")]
    assert program.main(words) == 2
    assert "pip install 'evs[view]'" in capsys.readouterr().err


def test_nothing_else_imports_rerun() -> None:
    code = (
        "import sys, evs, evs.drivers.viewer, evs.launch.support.live_view\n"
        "from evs.launch.main import main\n"
        "try: main(['view', '--help'])\n"
        "except SystemExit: pass\n"
        "assert 'rerun' not in sys.modules and 'pyarrow' not in sys.modules\n"
    )
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_a_window_opens_only_where_there_is_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not live_view.has_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert live_view.has_display()
