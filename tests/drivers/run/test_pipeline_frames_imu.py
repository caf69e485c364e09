"""`evs emulate` with frames and IMU: every sink has them, and they are those of a World."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.files import read
from evs.drivers.run import config as pipeline
from evs.drivers.run.run import run
from evs.drivers.sink import Sink, Stream
from evs.emulator import World
from evs.launch import main as program
from evs.msgs import EventPacket, EvsError, StreamInfo, empty_imu

SCENE = Path(__file__).parents[3] / "config" / "scenes" / "pendulum.xml"
WORDS = [
    "emulate",
    f"scene.file={SCENE}",
    "camera.body=lower",
    "camera.pos=0.15,-0.4,0.1",
    "camera.xyaxes=1,0,0,0,0.6,0.8",
    "sensor.width=40",
    "sensor.height=30",
    "duration_s=0.12",
    "seed=3",
]
BOTH = [
    "sensor.aps.enabled=true",
    "sensor.aps.rate_hz=50",
    "sensor.aps.exposure_us=4000",
    "sensor.imu.enabled=true",
    "sensor.imu.rate_hz=2000",
]


def world_of(words: list[str]) -> World:
    pairs = [(key, value) for key, _, value in (word.partition("=") for word in words[1:])]
    return World.from_config(pipeline.load(None, pairs))


def test_recordings_hold_what_a_world_gives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [tmp_path / "run.aedat4", tmp_path / "run.npz"]
    for path in paths:
        assert program.main([*WORDS, *BOTH, f"record={path}"]) == 0
    world = world_of([*WORDS, *BOTH])
    (camera,) = world.cameras
    frames, samples, events = [], [empty_imu()], b""
    for (packet,) in world.run(0.12):
        frames += camera.frames
        samples.append(camera.imu)
        events += packet.events.tobytes()
    assert len(frames) == 6
    felt = np.concatenate(samples)
    # the camera swings with the bob, so it feels more than its weight
    assert len(felt) == 237
    assert np.abs(felt["angular_velocity"]).max() > 0.01
    for path in paths:
        recording = read(path)
        assert recording.tobytes() == events
        assert recording.frames == tuple(frames)
        assert recording.imu.tobytes() == felt.tobytes()
        report = json.loads(Path(f"{path}.report.json").read_text())
        (sink,) = report["sinks"]
        assert (sink["frames"], sink["imu_samples"]) == (6, 237)
        assert report["config"]["sensor"]["aps"]["rate_hz"] == 50.0
    capsys.readouterr()


def test_a_recording_of_events_alone_is_the_same_bytes_as_with_them_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [tmp_path / "never.aedat4", tmp_path / "off.aedat4"]
    assert program.main([*WORDS, f"record={paths[0]}"]) == 0
    off = [word.replace("=true", "=false") for word in BOTH]
    assert program.main([*WORDS, *off, f"record={paths[1]}"]) == 0
    recordings = [read(path) for path in paths]
    assert recordings[0].tobytes() == recordings[1].tobytes()
    assert recordings[1].frames == ()
    assert not recordings[1].stream.frames
    capsys.readouterr()


class EventsOnly(Sink):
    """A sink of somebody's own, which knows nothing of frames."""

    def __init__(self) -> None:
        self.events = 0

    def open(self, streams: Sequence[StreamInfo]) -> None:
        assert streams[0].frames

    def write(self, packet: EventPacket) -> None:
        self.events += len(packet)

    def close(self) -> dict[str, Any]:
        return {"type": "mine"}


def test_a_sink_that_takes_events_alone_gets_those() -> None:
    sink = EventsOnly()
    report = run(world_of([*WORDS, *BOTH]), [sink], 0.05)
    assert report.ended == "complete"
    assert report.events == sink.events > 0


class Full(EventsOnly):
    """A sink whose disk is full at the first frame."""

    streams = frozenset({Stream.EVENTS, Stream.FRAMES})

    def write_frame(self, frame: object) -> None:
        raise OSError(28, "No space left on device")


def test_a_disk_that_is_full_at_a_frame_ends_the_run_in_one_line() -> None:
    sink = Full()
    with pytest.raises(EvsError, match="cannot write: No space left on device"):
        run(world_of([*WORDS, *BOTH, "sensor.shot_noise_rate_hz=100"]), [sink], 0.05)
    assert sink.events > 0


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (
            "sensor.aps.shutter=rollin",
            "no shutter (sensor.aps.shutter) 'rollin'; there is: rolling",
        ),
        ("sensor.aps.rate=5", "at sensor.aps.rate: unknown key; nearest known: sensor.aps.rate_hz"),
        ("sensor.imu.gyroscope_bias=1,2", "at sensor.imu.gyroscope_bias"),
        ("sensor.aps.rate_hz=200", "but a frame takes"),
    ],
)
def test_bad_keys_are_one_line(word: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main([*WORDS, *BOTH, word]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
