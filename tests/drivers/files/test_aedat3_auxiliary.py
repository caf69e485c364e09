"""AEDAT3.1: frames and IMU samples, plain and as cAER compresses them."""

from __future__ import annotations

import io
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from evs.drivers import files
from evs.drivers.files.aedat3.compressed import expanded
from evs.drivers.files.integrity import DamagedPacketWarning
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo, empty_imu, make_events

STREAM = StreamInfo(6, 4, camera="eye", sensor="davis346", frames=True, imu=True)
WRAP = 1 << 31


def header(compression: str = "RAW") -> bytes:
    return (
        f"#!AER-DAT3.1\r\n#Format: {compression}\r\n#Source 1: DAVIS346\r\n"
        "#Start-Time: 2017-01-01 10:00:00 (TZ+0100)\r\n#!END-HEADER\r\n"
    ).encode()


def image(seed: int, dtype: Any = np.uint16) -> Any:
    most = np.iinfo(dtype).max + 1
    return np.random.default_rng(seed).integers(0, most, (4, 6)).astype(dtype)


def samples(*stamps: int) -> Any:
    made = empty_imu(len(stamps))
    made["t"] = stamps
    random = np.random.default_rng(1)
    made["acceleration"] = random.normal(0, 9, (len(stamps), 3))
    made["angular_velocity"] = random.normal(0, 2, (len(stamps), 3))
    made["temperature"] = 25.5
    return made


def packet(kind: int, size: int, stamp_at: int, *events: bytes, overflow: int = 0) -> bytes:
    """Return a packet, packed by hand."""
    count = len(events)
    head = struct.pack("<hhiiiiii", kind, 1, size, stamp_at, overflow, count, count, count)
    return head + b"".join(events)


def frame(pixels: Any, stamps: tuple[int, ...], channels: int = 1, info: int = 1) -> bytes:
    """Return a frame event, packed by hand.

    Args:
        pixels: The image (h, w) of whole numbers; w counts channels, too.
        stamps: Begin and end of the frame, begin and end of the exposure, us.
        channels: How many channels the header declares.
        info: The other bits of the info word.
    """
    sides = pixels.shape[1], pixels.shape[0]
    head = struct.pack("<I8i", info | channels << 1, *stamps, *sides, 0, 0)
    return head + pixels.astype("<u2").tobytes()


def record(path: Path) -> None:
    """Record two ticks with all kinds of data; the clock wraps between the two."""
    sink: Any = files.recorder_for(path)
    sink.open([STREAM])
    for seq, begin in enumerate((100, WRAP - 100)):
        stamps = begin, begin + 10, begin + 150, begin + 200
        sink.write_frame(Frame(seq, *stamps, image(seq), "eye"))
        sink.write_imu(ImuPacket(seq, samples(begin, begin + 150), "eye"))
        events = make_events([begin + 201, begin + 300], [0, 5], [0, 3], [1, 0])
        sink.write(EventPacket(seq, 0, 0, 6, 4, events, "eye"))
    said = sink.close()
    assert (said["frames"], said["imu_samples"], said["events"]) == (2, 4, 4)


def test_frames_and_samples_come_back(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    record(path)
    got = files.read(path)
    assert got.stream == STREAM
    assert got["t"].tolist() == [301, 400, WRAP + 101, WRAP + 200]
    assert [one.begin_us for one in got.frames] == [100, WRAP - 100]
    assert [one.end_us for one in got.frames] == [300, WRAP + 100]
    assert got.frames[1] == Frame(1, WRAP - 100, WRAP - 90, WRAP + 50, WRAP + 100, image(1), "eye")
    assert got.imu["t"].tolist() == [100, 250, WRAP - 100, WRAP + 50]
    for name in ("acceleration", "angular_velocity", "temperature"):
        np.testing.assert_allclose(got.imu[name][:2], samples(0, 1)[name], rtol=1e-6)
    found = files.summary(path)
    assert (found.frames, found.imu_samples, found.left_out) == (2, 4, {})
    # the frames and samples of a tick come before its events
    kinds = [type(message).__name__ for message in files.messages(path)]
    assert kinds[:3] == ["ImuPacket", "Frame", "EventPacket"] or kinds[:3] == [
        "Frame", "ImuPacket", "EventPacket"
    ]  # fmt: skip


def test_the_bytes_are_libcaers(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    sink: Any = files.recorder_for(path)
    sink.open([STREAM])
    sink.write_frame(Frame(0, 5, 6, 7, 8, image(3), "eye"))
    sample = empty_imu(1)
    sample["t"], sample["acceleration"] = WRAP + 9, (0.0, -9.80665, 0.0)
    sample["angular_velocity"], sample["temperature"] = (np.pi, 0, 0), 30.0
    sink.write_imu(ImuPacket(0, sample, "eye"))
    sink.close()
    rest = path.read_bytes().partition(b"#!END-HEADER\r\n")[2]
    imu = struct.pack("<Ii7f", 1, 9, 0, -1, 0, 180, 0, 0, 30)
    assert rest == packet(2, 84, 12, frame(image(3), (5, 8, 6, 7))) + packet(
        3, 36, 4, imu, overflow=1
    )


def test_frames_of_8_bits_are_spread_over_16(tmp_path: Path) -> None:
    sink: Any = files.recorder_for(tmp_path / "a.aedat3")
    sink.open([STREAM])
    pixels = image(4, np.uint8)
    sink.write_frame(Frame(0, 1, 2, 3, 4, pixels, "eye"))
    sink.close()
    (got,) = files.read(tmp_path / "a.aedat3").frames
    assert got.pixels.dtype == np.uint16
    assert (got.pixels == pixels.astype(int) * 257).all()


def test_what_cannot_be_held_is_refused(tmp_path: Path) -> None:
    sink: Any = files.recorder_for(tmp_path / "a.aedat3")
    sink.open([StreamInfo(6, 4)])
    with pytest.raises(EvsError, match="opened without frames"):
        sink.write_frame(Frame(0, 1, 2, 3, 4, image(4)))
    with pytest.raises(EvsError, match="opened without imu"):
        sink.write_imu(ImuPacket(0, samples(5)))
    sink.close()
    sink = files.recorder_for(tmp_path / "b.aedat3")
    with pytest.raises(EvsError, match="not open"):
        sink.write_frame(Frame(0, 1, 2, 3, 4, image(4)))
    sink.open([STREAM])
    with pytest.raises(EvsError, match=r"cannot record frames at -1 us .*\.aedat4"):
        sink.write_frame(Frame(0, -1, 2, 3, 4, image(4)))
    sink.close()


def test_foreign_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    colour = np.zeros((4, 18))
    nine = struct.pack("<Ii10f", 1, 40, *range(10))
    broken = struct.pack("<Ii7f", 1, 50, float("nan"), *range(6))
    six = struct.pack("<Ii7f", 1, 60, 1, 2, 3, 90, 180, 270, 20)
    packets = [
        packet(2, 84, 12, frame(image(1), (10, 40, 20, 30)), frame(image(2), (50, 80, 60, 70))),
        packet(2, 180, 12, frame(colour, (1, 1, 1, 1), 3)),
        packet(2, 84, 12, frame(image(1), (90, 80, 85, 86))),
        packet(4, 48, 4, nine),
        packet(3, 36, 4, broken, six),
    ]
    # the width in pixels, not the length of a row of channels
    packets[1] = packets[1].replace(struct.pack("<2i", 18, 4), struct.pack("<2i", 6, 4))
    path.write_bytes(header() + b"".join(packets))
    stream = files.stream_of(path)
    assert (stream.frames, stream.imu, stream.width) == (True, True, 346)
    told = pytest.warns(DamagedPacketWarning, match="2 damaged packets .* stamps")
    with told, pytest.warns(files.LeftOutWarning):
        list(files.messages(path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        got = files.read(path)
        assert [one.pixels.tolist() for one in got.frames] == [
            image(seed).tolist() for seed in (1, 2)
        ]
        assert got.frames[1].exposure_begin_us == 60
    assert got.imu["t"].tolist() == [40, 60]
    np.testing.assert_allclose(got.imu["angular_velocity"][1], np.pi * np.array([0.5, 1, 1.5]))
    found = files.summary(path)
    assert found.left_out == {"frames that are not grey": 1, "compass readings": 1}


def serialised(events: list[tuple[int, int]]) -> bytes:
    """Pack events (data, stamp) as cAER does, one by one."""
    out, at = b"", 0
    while at < len(events):
        end = at
        while end < len(events) and events[end][1] == events[at][1]:
            end += 1
        if end - at < 3:
            out += struct.pack("<II", *events[at])
            at += 1
            continue
        out += struct.pack("<II", events[at][0], events[at][1] | 1 << 31)
        out += struct.pack("<II", events[at + 1][0], end - at - 2)
        out += b"".join(struct.pack("<I", data) for data, _ in events[at + 2 : end])
        at = end
    return out


@pytest.mark.parametrize("seed", range(40))
def test_runs_of_one_stamp_are_expanded(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(0, 200))
    stamps = np.cumsum(random.integers(0, (1, 2, 3, 9)[seed % 4] + 1, count))
    # data with bit 31 set means an x of 16384 or more
    data = random.integers(0, 1 << 32, count)
    body = serialised(list(zip(data.tolist(), stamps.tolist(), strict=True)))
    got = expanded(body, count)
    assert got is not None
    assert got["data"].tolist() == data.tolist()
    assert got["stamp"].tolist() == stamps.tolist()
    assert expanded(body, count + 1) is None
    if count:
        assert expanded(body[:-4], count) is None


def png(pixels: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint16)).save(out, "PNG")
    return out.getvalue()


def packed(kind: int, size: int, stamp_at: int, count: int, body: bytes) -> bytes:
    head = (kind | 0x8000, 1, size, stamp_at, 0, len(body), count, count)
    return struct.pack("<HhiiiIii", *head) + body


def test_compressed_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    events = [(x << 17 | 2 << 2 | 2 | 1, t) for x, t in ((1, 5), (2, 5), (3, 5), (4, 6), (5, 7))]
    pictures = []
    for seed in (1, 2):
        data = png(image(seed))
        stamps = tuple(40 * seed + at for at in (-30, 0, -20, -10))
        head = frame(np.zeros((4, 6)), stamps, info=1 | 1 << 31)[:36]
        pictures.append(head + struct.pack("<i", len(data)) + data)
    # a frame that compression did not make smaller
    pictures.insert(1, frame(image(7), (41, 44, 42, 43)))
    frames = packed(2, 84, 12, 3, b"".join(pictures))
    path.write_bytes(header("Compressed") + packed(1, 8, 4, 5, serialised(events)) + frames)
    got = files.read(path)
    assert got.tolist() == [(t, data >> 17, 2, 1) for data, t in events]
    assert [one.pixels.tolist() for one in got.frames] == [
        image(seed).tolist() for seed in (1, 7, 2)
    ]
    assert files.summary(path).compression == "Compressed"
    wrong = packed(1, 8, 4, 6, serialised(events)) + packed(1, 8, 4, 5, serialised(events))
    path.write_bytes(header("Serial-TS") + wrong)
    with pytest.warns(DamagedPacketWarning, match="its 36 bytes are no 6 events"):
        assert len(files.read(path)) == 5


def test_a_picture_that_is_none_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat3"
    good = png(image(1))
    for data in (b"no picture", png(image(1)[:3]), good[:40], good[:-30]):
        head = frame(np.zeros((4, 6)), (10, 40, 20, 30), info=1 | 1 << 31)[:36]
        body = head + struct.pack("<i", len(data)) + data
        path.write_bytes(header("Compressed") + packed(2, 84, 12, 1, body))
        with pytest.raises(EvsError, match=r"none of its 1 packets can be read.*no such picture"):
            list(files.messages(path))


def test_convert_keeps_frames_and_samples(tmp_path: Path) -> None:
    record(tmp_path / "a.aedat3")
    done = files.convert(tmp_path / "a.aedat3", tmp_path / "b.aedat4")
    assert (done.frames, done.imu_samples, done.left_out) == (2, 4, {})
    files.convert(tmp_path / "b.aedat4", tmp_path / "c.aedat3")
    first, last = files.read(tmp_path / "a.aedat3"), files.read(tmp_path / "c.aedat3")
    assert first.tobytes() == last.tobytes()
    assert first.frames == last.frames
    assert first.imu.tobytes() == last.imu.tobytes()
