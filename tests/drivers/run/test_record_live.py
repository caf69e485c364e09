"""evs record: a live camera into a file, the same as its own recording, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.bus import Publisher, subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.clock import Pacer, monotonic_s
from evs.drivers.files.formats import to_write
from evs.drivers.run.run import run
from evs.drivers.run.stream_recorder import StreamRecorder, StreamRecording
from evs.emulator import World
from evs.emulator.config import ApsConfig, ImuConfig, SensorConfig
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

pytestmark = pytest.mark.integration

SCENE = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="5 5 .1"/>
<body pos="0 0 1"><freejoint/><geom type="box" size=".2 .2 .2"/>
<camera name="eye" pos="1 -2 .5" xyaxes="1 .5 0 0 .2 1"/></body></worldbody></mujoco>"""
BESIDE: dict[str, Any] = {"frames": True, "imu": True, "camera_info": True}


def small(camera: str = "cam") -> StreamInfo:
    return StreamInfo(32, 24, camera, sensor="dvs128", seed=3)


def packet(seq: int, camera: str = "cam") -> EventPacket:
    events = make_events([1000 * seq + 1] * 50, [seq % 32] * 50, [1] * 50, [1] * 50)
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 32, 24, events, camera)


@pytest.mark.parametrize("ending", [".aedat4", ".npz"])
def test_it_is_the_cameras_own_recording(tmp_path: Path, ending: str) -> None:
    address = free_address()
    own, live = tmp_path / f"own{ending}", tmp_path / f"live{ending}"
    aps = ApsConfig(enabled=True, rate_hz=50.0, exposure_us=3000)
    sensor = SensorConfig("davis346", width=32, height=24, aps=aps, imu=ImuConfig(enabled=True))
    world = World(mujoco.MjSpec.from_string(SCENE))
    world.add_camera("eye", sensor=sensor)
    taken: list[StreamRecording] = []
    with subscribe(address, **BESIDE) as stream:
        recording = threading.Thread(
            target=lambda: taken.append(StreamRecorder(stream, str(live)).run([]))
        )
        recording.start()
        recorder = to_write(own).record(own)
        run(world, [Publisher(address, wait_for=1), recorder], 0.25)
        recording.join(60)
    (told,) = taken
    theirs, ours = files.read(own), files.read(live)
    assert (told.packets, told.lost, told.ended) == (250, 0, "the camera has ended")
    assert told.events == len(theirs) > 0
    assert ours.tobytes() == theirs.tobytes()
    assert list(ours.frames) == list(theirs.frames)
    assert len(ours.frames) == told.frames > 5
    assert ours.imu.tobytes() == theirs.imu.tobytes()
    assert len(ours.imu) == told.imu_samples > 200
    for key in ("width", "height", "camera", "sensor", "camera_info"):
        assert getattr(ours.stream, key) == getattr(theirs.stream, key)


def test_stopped_before_the_first_status_it_keeps_what_came(tmp_path: Path) -> None:
    address, file = free_address(), tmp_path / "short.aedat4"
    stopped: list[str] = []
    taken: list[StreamRecording] = []
    with subscribe(address, **BESIDE) as stream:
        recorder = StreamRecorder(stream, str(file))
        thread = threading.Thread(target=lambda: taken.append(recorder.run(stopped)))
        thread.start()
        sender = Publisher(address, wait_for=1, linger_s=0.1)
        sender.open([small()])
        for seq in range(30):
            sender.write(packet(seq))
        deadline_s = monotonic_s() + 20
        while stream.packets < 30 and monotonic_s() < deadline_s:
            thread.join(0.02)
        stopped.append("interrupted")
        thread.join()
        sender.close()
    assert (taken[0].packets, taken[0].ended) == (30, "interrupted")
    assert len(files.read(file)) == 30 * 50


def test_several_cameras_want_a_choice(tmp_path: Path) -> None:
    address = free_address()
    failed: list[str] = []
    with subscribe(address, **BESIDE) as stream:
        recorder = StreamRecorder(stream, str(tmp_path / "two.aedat4"))

        def take() -> None:
            try:
                recorder.run([])
            except EvsError as error:
                failed.append(str(error))

        thread = threading.Thread(target=take)
        thread.start()
        sender = Publisher(address, wait_for=1, linger_s=0.1)
        sender.open([small("left"), small("right")])
        sender.write(packet(0, "left"))
        sender.write(packet(0, "right"))
        thread.join()
        sender.close()
    assert "several cameras" in failed[0]
    assert "choose one of left, right" in failed[0]


def program(address: str, file: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "error", "-m", "evs.launch.main", "record", address, str(file)]
    pipe = subprocess.PIPE
    return subprocess.Popen([*command, *more], stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize(
    ("more", "code", "says"),
    [
        (["--timeout", "0.3"], 2, "nothing came from tcp://"),
        (["--duration", "0"], 2, "--duration 0.0 is not possible"),
        (["--camera", "a\nb"], 2, "camera name"),
    ],
)
def test_nothing_to_record_is_one_line_and_no_file(
    tmp_path: Path, more: list[str], code: int, says: str
) -> None:
    file = tmp_path / "none.aedat4"
    recording = program(free_address(), file, *more)
    _, told = recording.communicate(timeout=60)
    assert recording.returncode == code
    assert says in told.splitlines()[-1]
    assert not file.exists()


def test_killed_it_leaves_what_it_had_and_the_camera_goes_on(tmp_path: Path) -> None:
    address, file = free_address(), tmp_path / "killed.aedat4"
    recording = program(address, file)
    sender = Publisher(address, wait_for=1, wait_s=60, linger_s=1.0)
    sender.open([small()])
    pacer, slowest_s = Pacer(1.0), 0.0
    for seq in range(1500):
        pacer.wait_until(1000 * seq)
        if seq == 1000:
            os.kill(recording.pid, signal.SIGKILL)
        begin_s = monotonic_s()
        sender.write(packet(seq))
        slowest_s = max(slowest_s, monotonic_s() - begin_s)
    sender.close()
    recording.communicate()
    # the bound leaves room for a busy machine; to wait for the dead would be for ever
    assert slowest_s < 1.0
    found = files.read(file)
    # whole packets in their order, and most of the second that it had
    assert len(found) % 50 == 0
    assert len(found) > 50 * 300
    seqs = np.asarray(found["t"])[::50] // 1000
    np.testing.assert_array_equal(seqs, np.arange(seqs[0], seqs[0] + len(seqs)))


def test_duration_and_the_line_at_the_end(tmp_path: Path) -> None:
    address, file = free_address(), tmp_path / "part.npz"
    recording = program(address, file, "--duration", "0.25")
    sender = Publisher(address, wait_for=1, wait_s=60, linger_s=1.0)
    sender.open([small()])
    for seq in range(400):
        sender.write(packet(seq))
    sender.close()
    out, _ = recording.communicate(timeout=60)
    assert recording.returncode == 0
    assert "250 packets, 12,500 events, 0 packets lost; 0.25 s are recorded" in out
    assert len(files.read(file)) == 12_500
