"""`evs play`: parts of recordings, several rounds, and every live sink."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import clock, files
from evs.drivers.bus import subscribe
from evs.drivers.bus.address import free_address
from evs.launch.main import main
from evs.msgs import (
    EventPacket,
    Events,
    Frame,
    ImuPacket,
    StreamInfo,
    TriggerPacket,
    empty_imu,
    frame_triggers,
    join_events,
    make_events,
)

Capture = pytest.CaptureFixture[str]
STREAM = StreamInfo(64, 48, camera="eye", frames=True, imu=True, triggers=True)
TICKS = 40


def packet(tick: int) -> EventPacket:
    t = 1000 * tick + np.arange(1, 1001, 10)
    return EventPacket(
        tick,
        1000 * tick,
        1000 * tick + 1000,
        64,
        48,
        make_events(t, t % 64, t % 48, t // 10 % 2),
        "eye",
    )


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """40 ms of events, IMU samples in each, four frames with their triggers."""
    path = tmp_path / "in.aedat4"
    sink: Any = files.recorder_for(path)
    sink.open([STREAM])
    for tick in range(TICKS):
        if tick % 10 == 5:
            stamps = (1000 * tick - 900, 1000 * tick - 800, 1000 * tick - 300, 1000 * tick)
            frame = Frame(tick // 10, *stamps, np.full((48, 64), tick, np.uint8), "eye")
            sink.write_frame(frame)
            sink.write_triggers(TriggerPacket(tick // 10, frame_triggers(frame), "eye"))
        samples = empty_imu(2)
        samples["t"] = 1000 * tick + np.array([400, 900])
        sink.write_imu(ImuPacket(tick, samples, "eye"))
        sink.write(packet(tick))
    sink.close()
    return path


EVERY = join_events([packet(tick).events for tick in range(TICKS)])


def play(*words: str | Path) -> int:
    return main(["play", *map(str, words), "--fast"])


def into(path: Path, kind: str) -> list[str]:
    return [f"sink.0.type={kind}", f"sink.0.file={path}"]


def test_everything_arrives_in_every_sink(recording: Path, tmp_path: Path, capsys: Capture) -> None:
    words = [
        *into(tmp_path / "a.npz", "npz"),
        "sink.1.type=csv",
        f"sink.1.file={tmp_path / 'b.csv'}",
    ]
    assert play(recording, *words) == 0
    given, whole = files.read(recording), files.read(tmp_path / "a.npz")
    assert whole.tobytes() == given.tobytes() == EVERY.tobytes()
    assert whole.frames == given.frames
    assert whole.imu.tobytes() == given.imu.tobytes()
    assert whole.triggers.tobytes() == given.triggers.tobytes()
    assert files.read(tmp_path / "b.csv").tobytes() == EVERY.tobytes()
    said = capsys.readouterr().out
    assert re.search(r"40 packets, 4,000 events, 4 frames, 80 IMU samples, \d+ triggers; ", said)
    # a CSV file alone has no room for them
    assert play(recording, *into(tmp_path / "c.csv", "csv")) == 0
    assert "4 frames left out (no sink takes them)" in capsys.readouterr().out


def test_a_part_is_cut_to_the_microsecond(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert play(recording, *into(path, "npz"), "--start", "0.0105", "--stop", "0.02") == 0
    part = files.read(path)
    inside = (EVERY["t"] > 10_500) & (EVERY["t"] <= 20_000)
    assert np.array_equal(part, EVERY[inside])
    assert [frame.end_us for frame in part.frames] == [15_000]
    assert ((part.imu["t"] > 10_500) & (part.imu["t"] <= 20_000)).all()
    assert len(part.imu) == 19


def test_a_part_of_a_recording_in_unix_time(recording: Path, tmp_path: Path) -> None:
    unix_us, moved, path = 1_690_000_000_000_000, tmp_path / "unix.npz", tmp_path / "a.npz"
    t = EVERY["t"] + unix_us
    np.savez(moved, t=t, x=EVERY["x"], y=EVERY["y"], p=EVERY["p"])
    assert play(moved, *into(path, "npz"), "--start", "0.0105", "--stop", "0.02") == 0
    inside = (EVERY["t"] > 10_500) & (EVERY["t"] <= 20_000)
    assert np.array_equal(files.read(path)["t"], t[inside])


def later(events: Events, by_us: int) -> Events:
    moved = events.copy()
    moved["t"] += by_us
    return moved


def test_rounds_follow_each_other_in_time(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    assert play(recording, *into(path, "aedat4"), "--rounds", "3") == 0
    whole = files.read(path)
    # a frame of the first round begins before the first event, and the round with it
    assert np.array_equal(whole, join_events([later(EVERY, 40_000 * k) for k in range(3)]))
    assert len(whole.frames) == 12
    assert [frame.seq for frame in whole.frames] == list(range(12))
    assert len(whole.imu) == 3 * 2 * TICKS
    part = tmp_path / "b.aedat4"
    words = ["--start", "0.01", "--stop", "0.03", "--rounds", "2"]
    assert play(recording, *into(part, "aedat4"), *words) == 0
    inside = EVERY[(EVERY["t"] > 10_000) & (EVERY["t"] <= 30_000)]
    assert np.array_equal(files.read(part), join_events([inside, later(inside, 20_000)]))


def test_rounds_keep_the_pace(
    recording: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    waited: list[int] = []
    monkeypatch.setattr(clock.Pacer, "wait_until", lambda self, t_us: waited.append(t_us))
    assert play(recording, *into(tmp_path / "a.npz", "npz"), "--rounds", "2") == 0
    assert max(waited) == 80_000
    packets = [t_us for t_us in waited if t_us % 1000 == 0]
    assert len(set(packets)) == 80


def player(*words: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "evs.launch.main", "play", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.integration
def test_the_bus_gets_rounds_without_end_until_it_is_stopped(recording: Path) -> None:
    address = free_address()
    process = player(recording, "--rounds", "0", "--fast", "--address", address, "--wait-for", "1")
    got = []
    with subscribe(address, timeout_s=20.0) as stream:
        for one in stream:
            got.append(one)
            if len(got) == 3 * TICKS:
                process.terminate()
                break
    _, warned = process.communicate(timeout=30)
    assert process.returncode == 130, warned
    times = np.concatenate([one.events["t"] for one in got])
    assert (np.diff(times) > 0).all()
    assert [one.seq for one in got] == list(range(len(got)))


@pytest.mark.integration
def test_dvs_own_reader_gets_it(recording: Path) -> None:
    pytest.importorskip("dv_processing")
    port = int(free_address().rpartition(":")[2])
    client = Path(__file__).parents[1] / "support" / "oracles" / "dv_client.py"
    reader = subprocess.Popen(
        [sys.executable, str(client), "events", "127.0.0.1", str(port)],
        stdout=subprocess.PIPE,
        text=True,
    )
    words = ["sink.0.type=dv", f"sink.0.address=tcp://127.0.0.1:{port}", "sink.0.wait_for=1"]
    process = player(recording, *words, "--rounds", "2")
    try:
        assert process.wait(60) == 0, process.communicate()[1]
        said, _ = reader.communicate(timeout=60)
    finally:
        for each in (process, reader):
            each.kill()
            each.communicate()
    assert f'"events": {2 * len(EVERY)}' in said
    assert '"ends": [1, 79991]' in said


LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces></General>'
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers>'
    "</Discovery></Domain></CycloneDDS>"
)


@pytest.mark.integration
def test_a_node_of_ros_2_gets_it(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds")
    from evs.msgs.codecs import PayloadReader
    from reference.ros_readers import Ears

    domain = 1 + os.getpid() % 200
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    # the player waits for a reader of events: the others are announced before it
    ears = Ears(domain, "/eye", ("imu", "image_raw", "events"), reliable=True)
    words = ["sink.0.type=ros2", f"sink.0.domain_id={domain}", "sink.0.wait_for=1"]
    words += ["sink.0.reliable=true"]
    monkeypatch.delenv("CYCLONEDDS_URI")
    process = player(recording, *words, "--speed", "0.2")
    heard: dict[str, list[Any]] = {name: [] for name in ("events", "image_raw", "imu")}
    running = True
    while running:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
            running = False
        for name, found in heard.items():
            # the end of the writer comes as a sample without data
            found += [one for one in ears.take(name) if one.sample_info.valid_data]
    _, warned = process.communicate()
    assert process.returncode == 0, warned
    reader = PayloadReader("evt3")
    events = join_events([reader.events(bytes(one.events), 0) for one in heard["events"]])
    assert len(heard["image_raw"]) == 4
    assert len(heard["imu"]) == 2 * TICKS
    assert np.array_equal(events, EVERY)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["render.spp=4"], "no key 'render.spp' here: give those of sinks"),
        (["sink.0.type=zqm"], "at sink.0.type: no sink type 'zqm'"),
        (["sink.0.type=ros2", "sink.0.erc_rate=5"], "at sink.0.erc_rate: changes the sensor"),
        (["sink.0.type=dv"], "at sink.0.address: missing"),
        (["sink.0.type=npz", "sink.0.file={same}"], "already exists"),
        (["sink.0.type=npz", "sink.0.file=a.npz", "--wait-for", "1"], "--wait-for is for the bus"),
        (["--rounds", "-1"], "-1 rounds are not possible"),
        (["--start", "2", "--stop", "1"], "nothing lies between"),
        (["--start", "nan"], "--start is nan"),
        (["sink.0.type=npz", "sink.0.file={new}", "--start", "9"], "has nothing in this part"),
    ],
)
def test_bad_words_are_one_line(
    recording: Path, tmp_path: Path, capsys: Capture, words: list[str], said: str
) -> None:
    (tmp_path / "same.npz").touch()
    names = {"same": tmp_path / "same.npz", "new": tmp_path / "new.npz"}
    assert play(recording, *(word.format(**names) for word in words)) == 2
    told = capsys.readouterr().err
    assert said in told
    assert sum(line.startswith("evs: ") for line in told.splitlines()) == 1
