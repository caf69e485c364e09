"""Triggers: what a frame brings, round trips, other projects' readers, a camera's own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import evs
from evs.drivers import files
from evs.drivers.files.aedat4 import Aedat4File
from evs.drivers.files.aedat4.auxiliary import parse_triggers, triggers_body
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.launch import main as program
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    StreamInfo,
    Trigger,
    TriggerPacket,
    Triggers,
    frame_triggers,
    make_events,
    make_triggers,
)

SCRIPT = Path(__file__).parents[2] / "support" / "oracles" / "aedat4_oracles.py"
STREAM = StreamInfo(34, 26, triggers=True)
FORMS = ("none.aedat4", "lz4.aedat4", "zstd.aedat4", "a.npz")
WRAPS = [k * 2**bits + d for bits in (24, 31, 32) for k in (1, 3) for d in (-1, 0, 1)]


def record(path: Path, parts: list[Triggers], stream: StreamInfo = STREAM) -> None:
    compression = None if path.suffix == ".npz" else path.name.split(".")[0]
    sink = files.recorder_for(path, compression)
    sink.open([stream])
    for seq, part in enumerate(parts):
        sink.write_triggers(TriggerPacket(seq, part))
        begin = 10**7 * seq
        sink.write(EventPacket(seq, begin, begin + 9, 34, 26, make_events([begin + 1], 1, 2, 1)))
    said = sink.close()
    assert said["triggers"] == sum(map(len, parts))


@pytest.mark.parametrize("form", FORMS)
def test_triggers_come_back(tmp_path: Path, form: str) -> None:
    path = tmp_path / form
    parts = [make_triggers((10**7 * seq + k, k) for k in range(10)) for seq in range(20)]
    record(path, parts)
    recording = files.read(path)
    assert recording.stream == STREAM
    assert recording.triggers.tobytes() == np.concatenate(parts).tobytes()
    assert recording[:3].triggers.tolist()[3] == (3, Trigger.EXTERNAL_SIGNAL_PULSE)
    played = [one for one in files.messages(path) if isinstance(one, TriggerPacket)]
    if form == "a.npz":
        # one packet a tick, and t = 0 belongs to the tick before
        assert [len(one) for one in played] == [1, 9] * 20
        assert np.array_equal(np.concatenate([one.triggers for one in played]), recording.triggers)
    else:
        assert played == [TriggerPacket(seq, part) for seq, part in enumerate(parts)]


@pytest.mark.integration
def test_dv_processing_and_aedat_read_them(tmp_path: Path) -> None:
    # each kind, at the times where 24, 31 and 32 bits end
    marks = [(t, n % 10) for n, t in enumerate(sorted([0, 1, *WRAPS]))]
    paths = [tmp_path / form for form in FORMS[:3]]
    for path in paths:
        record(path, [make_triggers(marks), make_triggers([(2**33, 6)])])
    for reader in ("dv-beside", "aedat-beside"):
        done = subprocess.run(
            [sys.executable, SCRIPT, reader, *paths], capture_output=True, text=True, check=True
        )
        told = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        assert len(told) == 3
        for facts in told:
            assert facts["triggers"] == [*map(list, marks), [2**33, 6]], reader


@pytest.mark.integration
def test_we_read_those_of_dv_processing(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, "write", tmp_path], check=True, capture_output=True)
    paths = sorted(tmp_path.glob("*.aedat4"))
    assert len(paths) == 5
    for path in paths:
        recording = files.read(path)
        assert recording.stream.triggers
        stamps = recording["t"][4999::5000].tolist()
        rising = Trigger.EXTERNAL_SIGNAL_RISING_EDGE
        assert recording.triggers.tolist() == [(t, rising) for t in stamps]


def test_a_frame_is_marked_as_a_davis_marks_it() -> None:
    marks = frame_triggers(Frame(3, 100, 100, 250, 400, np.zeros((2, 2), np.uint8)))
    assert marks.tolist() == [
        (100, Trigger.APS_FRAME_START),
        (100, Trigger.APS_EXPOSURE_START),
        (250, Trigger.APS_EXPOSURE_END),
        (400, Trigger.APS_FRAME_END),
    ]


BALL = """
<mujoco><worldbody><light pos="0 -1 3"/><camera name="eye" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
<geom type="plane" size="2 2 .1"/><body pos="0 0 1"><freejoint/><geom size=".2"/></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("name", ["run.aedat4", "run.npz"])
def test_a_run_with_frames_records_their_triggers(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    size = ["sensor.width=32", "sensor.height=24"]
    frames = ["sensor.aps.enabled=true", "sensor.aps.rate_hz=100", "sensor.aps.exposure_us=4000"]
    words = ["emulate", "--scene", str(tmp_path / "ball.xml"), "--duration", "0.06", *size, *frames]
    path = tmp_path / name
    assert program.main([*words, "--record", str(path), "--quiet"]) == 0
    recording = evs.read(path)
    assert len(recording.frames) in (5, 6)
    wanted = [mark for frame in recording.frames for mark in frame_triggers(frame).tolist()]
    assert recording.triggers.tolist() == wanted
    assert program.main(["info", str(path)]) == 0
    assert f"triggers    {len(wanted)}\n" in capsys.readouterr().out


def test_a_recorder_takes_only_what_was_declared(tmp_path: Path) -> None:
    sink = files.recorder_for(tmp_path / "a.aedat4")
    sink.open([StreamInfo(34, 26)])
    with pytest.raises(EvsError, match="for a camera without triggers: set triggers"):
        sink.write_triggers(TriggerPacket(0, make_triggers([(1, 1)])))
    sink.close()
    assert list(Aedat4File.at(tmp_path / "a.aedat4").declared) == [0]


def test_bytes_that_are_no_triggers_are_refused() -> None:
    good = triggers_body(make_triggers([(5, 1), (9, 2)]))
    assert parse_triggers(good).tolist() == [(5, 1), (9, 2)]
    assert len(parse_triggers(triggers_body(make_triggers([])))) == 0
    backwards = np.concatenate([make_triggers([(9, 1)]), make_triggers([(5, 1)])])
    for body, says in (
        (good[:-1], "states another"),
        (good.replace(b"TRIG", b"EVTS"), "not a TRIG buffer"),
        (triggers_body(backwards), "run backwards"),
        (triggers_body(make_triggers([(2**63 - 1, 0)])), "beyond"),
    ):
        with pytest.raises(CorruptDataError, match=says):
            parse_triggers(body)
