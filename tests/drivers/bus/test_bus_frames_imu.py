"""Frames and IMU on the bus: beside the packets of their tick, only where asked for, counted."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.bus import Publisher, Subscription, subscribe
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo, empty_imu, make_events

STREAM = StreamInfo(8, 6, "cam", frames=True, imu=True)


def packet(seq: int, camera: str = "cam") -> EventPacket:
    events = make_events([1000 * seq + 1], [seq % 8], [0], [1])
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 8, 6, events, camera)


def frame(seq: int, camera: str = "cam") -> Frame:
    begin = 10_000 * seq
    image = np.full((6, 8), seq, np.uint8)
    return Frame(seq, begin, begin, begin + 5000, begin + 6000, image, camera)


def imu(seq: int, camera: str = "cam") -> ImuPacket:
    samples = empty_imu(2)
    samples["t"] = 1000 * seq + 500, 1000 * seq + 1000
    samples["acceleration"][:, 1] = -9.81
    return ImuPacket(seq, samples, camera)


class Sender:
    """Sends 30 ticks from a thread, once somebody listens."""

    def __init__(self, streams: list[StreamInfo], listeners: int = 1) -> None:
        self.publisher = Publisher("tcp://127.0.0.1:0", linger_s=5.0)
        self.publisher.open(streams)
        self.streams, self.listeners = streams, listeners
        self.said: dict[str, Any] = {}

    def send(self, skip: tuple[int, ...] = ()) -> None:
        while self.publisher.subscribers < self.listeners:
            self.publisher._read_requests(self.publisher._socket)  # type: ignore[arg-type]
        for seq in range(30):
            for stream in self.streams:
                if seq % 10 == 0 and seq not in skip:
                    self.publisher.write_frame(frame(seq // 10, stream.camera))
                if seq not in skip:
                    self.publisher.write_imu(imu(seq, stream.camera))
            for stream in self.streams:
                self.publisher.write(packet(seq, stream.camera))
        self.said = self.publisher.close()


@pytest.fixture
def heard() -> Iterator[Any]:
    threads = []

    def listen(
        sender: Sender, camera: str = "", skip: tuple[int, ...] = (), **options: Any
    ) -> tuple[Subscription, list[tuple[EventPacket, tuple[Frame, ...], tuple[ImuPacket, ...]]]]:
        stream = subscribe(sender.publisher.address, camera, timeout_s=20, **options)
        thread = threading.Thread(target=sender.send, args=(skip,))
        threads.append(thread)
        thread.start()
        found = [(one, stream.frames, stream.imu) for one in stream]
        thread.join(20)
        return stream, found

    yield listen
    for thread in threads:
        thread.join(20)


def test_each_packet_comes_with_the_frames_and_samples_of_its_tick(heard: Any) -> None:
    sender = Sender([STREAM])
    stream, found = heard(sender, frames=True, imu=True)
    assert stream.ended
    assert [one.seq for one, _, _ in found] == list(range(30))
    for one, frames, samples in found:
        assert frames == ((frame(one.seq // 10),) if one.seq % 10 == 0 else ())
        assert samples == (imu(one.seq),)
    assert sender.said["frames_sent"] == 3
    assert sender.said["imu_samples_sent"] == 60
    totals = stream.totals()
    assert (totals["frames"], totals["frames_lost"]) == (3, 0)
    assert (totals["imu"], totals["imu_lost"], totals["lost"]) == (30, 0, 0)
    assert totals["bytes"] == 30 * 16 + 3 * 48 + 60 * 64


@pytest.mark.parametrize("wanted", [(), ("frames",), ("imu",)])
def test_only_what_is_subscribed_to_travels(heard: Any, wanted: tuple[str, ...]) -> None:
    sender = Sender([STREAM])
    stream, found = heard(sender, **dict.fromkeys(wanted, True))
    assert len(found) == 30
    assert sum(len(frames) for _, frames, _ in found) == (3 if "frames" in wanted else 0)
    assert sum(len(samples) for _, _, samples in found) == (30 if "imu" in wanted else 0)
    assert sender.said["frames_sent"] == (3 if "frames" in wanted else 0)
    assert sender.said["imu_samples_sent"] == (60 if "imu" in wanted else 0)
    assert stream.bad_messages == 0


def test_gaps_are_counted(heard: Any) -> None:
    stream, found = heard(Sender([STREAM]), skip=(10, 11, 12), frames=True, imu=True)
    assert len(found) == 30
    totals = stream.totals()
    assert (totals["frames"], totals["frames_lost"]) == (2, 1)
    assert (totals["imu"], totals["imu_lost"]) == (27, 3)


def test_one_camera_of_two(heard: Any) -> None:
    both = [STREAM, replace(STREAM, camera="cam2")]
    stream, found = heard(Sender(both), "cam", frames=True, imu=True)
    assert len(found) == 30
    assert {one.camera for _, frames, _ in found for one in frames} == {"cam"}
    assert {one.camera for _, _, samples in found for one in samples} == {"cam"}
    assert set(stream.gaps) == {("frames", "cam"), ("imu", "cam")}
    stream, found = heard(Sender(both), frames=True)
    assert len(found) == 60
    assert sorted(stream.gaps) == [("frames", "cam"), ("frames", "cam2")]


def test_a_camera_that_was_not_opened_is_refused() -> None:
    publisher = Publisher("tcp://127.0.0.1:0", linger_s=0)
    with pytest.raises(EvsError, match="not open"):
        publisher.write_frame(frame(0))
    publisher.open([STREAM])
    with pytest.raises(EvsError, match="no camera on the bus 'other'"):
        publisher.write_imu(imu(0, "other"))
    publisher.close()


@pytest.mark.integration
def test_a_recording_is_played_with_everything_in_it(tmp_path: Path, address: str) -> None:
    path = tmp_path / "run.aedat4"
    recorder = files.recorder_for(path)
    recorder.open([STREAM])
    for seq in range(30):
        if seq % 10 == 0:
            recorder.write_frame(frame(seq // 10))  # type: ignore[attr-defined]
        recorder.write_imu(imu(seq))  # type: ignore[attr-defined]
        recorder.write(packet(seq))
    recorder.close()
    command = [sys.executable, "-W", "error", "-m", "evs.launch.main"]
    play = subprocess.Popen(
        [*command, "play", str(path), "--address", address, "--fast", "--wait-for", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    echo = subprocess.run(
        [*command, "echo", address, "--frames", "--imu", "--timeout", "30"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    said, _ = play.communicate(timeout=30)
    assert "30 packets, 30 events, 3 frames, 60 IMU samples" in said
    lines = echo.stdout.splitlines()
    assert lines[0] == ("cam frame 0  t 0.000000 s  exposure 5000 us  8x6 uint8  mean 0.0")
    assert "cam imu  t 0.000500 s  0.000 -9.810 0.000 m/s^2  0.000 0.000 0.000 rad/s" in lines
    assert lines[-1].startswith("packets 30  events 30  lost 0  frames/cam 3, lost 0")
