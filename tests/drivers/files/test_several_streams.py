"""Recordings with events of several cameras: one stream is read, the others are counted."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import evs
from evs.drivers import files
from evs.drivers.files import LeftOutWarning
from evs.drivers.files.aedat4 import auxiliary, layout
from evs.launch.main import main
from evs.msgs import Events, EvsError, Frame, empty_imu, make_events

LEFT = make_events(range(10, 310), [5] * 300, [7] * 300, [1, 0] * 150)
RIGHT = make_events(range(20, 220), [9] * 200, [3] * 200, [0, 1] * 100)


def aedat4(path: Path) -> None:
    """As dv records a stereo pair: the right camera has an IMU and frames too."""
    root = ET.Element("dv", version="2.0")
    out = ET.SubElement(root, "node", name="outInfo", path="/outInfo/")
    streams = ("EVTS left", "EVTS right", "IMUS right", "FRME right")
    for number, (kind, camera) in enumerate(map(str.split, streams)):
        node = ET.SubElement(out, "node", name=str(number))
        ET.SubElement(node, "attr", key="typeIdentifier", type="string").text = kind
        info = ET.SubElement(node, "node", name="info")
        for key, value in (("source", camera), ("sizeX", "64"), ("sizeY", "48")):
            ET.SubElement(info, "attr", key=key, type="string").text = value
    samples = empty_imu(3)
    samples["t"] = (30, 40, 50)
    frame = Frame(0, 10, 10, 20, 20, np.zeros((48, 64), np.uint8), "right")
    bodies = [
        (1, layout.events_body(RIGHT)),
        (2, auxiliary.imu_body(samples)),
        (3, auxiliary.frame_body(frame)),
        *((0, layout.events_body(part)) for part in np.split(LEFT, 3)),
    ]
    packets = (layout.PACKET_HEADER.pack(number, len(body)) + body for number, body in bodies)
    header = layout.io_header(0, ET.tostring(root, encoding="unicode"))
    path.write_bytes(layout.MAGIC + header + b"".join(packets))


def aedat3(path: Path) -> None:
    """Sources 1 and 2, as cAER numbers cameras."""
    out = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: left\r\n#Source 2: right\r\n#!END-HEADER\r\n"
    for source, events in ((2, RIGHT), (1, LEFT)):
        count = len(events)
        out += struct.pack("<HhiiiIii", 1, source, 8, 4, 0, count, count, count)
        for t, x, y, p in events.tolist():
            out += struct.pack("<Ii", x << 17 | y << 2 | p << 1 | 1, t)
    path.write_bytes(out)


MADE = {
    "a.aedat4": (aedat4, "0", "1"),
    "a.aedat3": (aedat3, "1", "2"),
}


@pytest.mark.parametrize("name", MADE)
def test_one_camera_is_read_and_the_others_are_counted(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    make, left, right = MADE[name]
    make(path)
    with pytest.warns(LeftOutWarning, match=rf"200 events of stream {right} \(right\)"):
        assert files.read(path).tobytes() == LEFT.tobytes()
    for stream in (right, int(right), "RIGHT"):
        with pytest.warns(LeftOutWarning, match=rf"300 events of stream {left} \(left\)"):
            recording = evs.read(path, stream=stream)
        assert recording.tobytes() == RIGHT.tobytes()
    with pytest.raises(EvsError, match=rf"'up'; choose one of: {left} \(left\), {right} \(right\)"):
        files.read(path, stream="up")
    found = files.summary(path)
    assert found.streams == {left: "left", right: "right"}
    assert found.left_out[f"events of stream {right} (right)"] == 200
    assert main(["info", str(path), "--stream", right]) == 0
    assert f"{left} (left): --stream {left}" in capsys.readouterr().out
    target = tmp_path / "b.csv"
    words = ["convert", str(path), str(target), "--stream", right, "--events-only"]
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(words) == 0
    assert f"300 events of stream {left} (left) were left out" in capsys.readouterr().err
    assert _events(target) == RIGHT.tolist()
    assert main(["play", str(path), "--fast", "--stream", right, "sink.0.type=csv",
                 f"sink.0.file={tmp_path / 'c.csv'}"]) == 0  # fmt: skip
    assert _events(tmp_path / "c.csv") == RIGHT.tolist()
    assert main(["view", str(path), "--stream", right]) == 0


def _events(path: Path) -> list[tuple[int, ...]]:
    events: Events = files.read(path)
    return events.tolist()


def test_frames_and_samples_are_those_of_the_same_camera(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    aedat4(path)
    left, right = files.summary(path), files.summary(path, stream=1)
    assert (left.frames, left.imu_samples) == (0, 0)
    assert left.left_out == {
        "events of stream 1 (right)": 200,
        "IMU samples of stream 2 (right)": 3,
        "frames of stream 3 (right)": 1,
    }
    assert (right.frames, right.imu_samples) == (1, 3)
    assert right.left_out == {"events of stream 0 (left)": 300}


def test_a_format_of_one_stream_takes_none(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1,1,1,1\n")
    with pytest.raises(EvsError, match="CSV, which needs no --stream: leave it out"):
        files.read(tmp_path / "a.csv", stream=1)
