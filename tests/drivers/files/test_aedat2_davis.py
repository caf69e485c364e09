"""AEDAT2: a DAVIS's frames (reset and signal reads) and IMU samples (seven words)."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.aedat2.davis import FrameAssembler, ImuAssembler
from evs.drivers.files.reading import ReadAsWarning
from evs.msgs import EvsError

W, H = 240, 180
HEADER = (
    b"#!AER-DAT2.0\r\n# jAER wrote this\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
)
APS, RESET, SIGNAL = 1 << 31, 0, 1 << 10


def word(address: int, stamp: int) -> bytes:
    return struct.pack(">Ii", address, stamp)


def pixel(x: int, y: int, p: int, stamp: int) -> bytes:
    """An event at x, y from the upper left, as a DAVIS240 says it."""
    return word((H - 1 - y) << 22 | (W - 1 - x) << 12 | p << 11, stamp)


def aps(x: int, y: int, read: int, adc: int, stamp: int) -> bytes:
    """A read of the pixel at x, y from the upper left: jAER counts x of frames from the left."""
    return word(APS | (H - 1 - y) << 22 | x << 12 | read | adc, stamp)


def imu(stamp: int, *values: int) -> bytes:
    """A sample of seven words: acceleration, temperature, angular velocity."""
    return b"".join(
        word(APS | 0xC00 | code << 28 | (value & 0xFFFF) << 12, stamp)
        for code, value in enumerate(values)
    )


def frame(light: np.ndarray, begin: int, rolling: bool = False) -> bytes:
    """A frame column by column as the chip reads it; one word a microsecond, then the exposure."""
    order = [(x, y) for x in range(W) for y in range(H)]
    reads = [(x, y, RESET, 1000) for x, y in order]
    signals = [(x, y, SIGNAL, 1000 - int(light[y, x])) for x, y in order]
    if rolling:
        # columns of the second kind follow 50 columns later
        merged = []
        for at in range(0, len(order) + 50 * H, H):
            merged += reads[at : at + H]
            merged += signals[max(0, at - 50 * H) : at - 50 * H + H] if at >= 50 * H else []
        return b"".join(aps(*one, begin + n // H) for n, one in enumerate(merged))
    told = [aps(*one, begin + n // H) for n, one in enumerate(reads)]
    return b"".join(told + [aps(*one, begin + 5000 + n // H) for n, one in enumerate(signals)])


def light(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 1001, (H, W))


def written(path: Path, *parts: bytes) -> Path:
    path.write_bytes(HEADER + b"".join(parts))
    return path


def test_frames_are_the_difference_of_two_reads(tmp_path: Path) -> None:
    path = written(
        tmp_path / "a.aedat",
        pixel(1, 2, 1, 10),
        frame(light(1), 100),
        pixel(3, 4, 0, 6000),
        frame(light(2), 10_000, rolling=True),
        pixel(5, 6, 1, 20_000),
    )
    got = files.read(path)
    assert got.tolist() == [(10, 1, 2, 1), (6000, 3, 4, 0), (20_000, 5, 6, 1)]
    assert (got.stream.frames, got.stream.imu) == (True, False)
    first, second = got.frames
    for seed, one in ((1, first), (2, second)):
        assert one.pixels.dtype == np.uint16
        # 1023 steps of the ADC are all of 16 bits
        assert (np.rint(one.pixels / 65535 * 1023) == light(seed)).all()
    stamps = first.begin_us, first.exposure_begin_us, first.exposure_end_us, first.end_us
    assert stamps == (100, 339, 5100, 5339)
    # a rolling shutter's exposure is the first column's
    assert (second.begin_us, second.exposure_begin_us) == (10_000, 10_000)
    assert second.exposure_end_us == 10_051
    found = files.summary(path)
    assert (found.frames, found.left_out, found.damaged_packets) == (2, {}, 0)


def test_messages_are_in_the_order_of_their_times(tmp_path: Path) -> None:
    path = written(
        tmp_path / "a.aedat",
        pixel(1, 2, 1, 10),
        frame(light(1), 100),
        imu(5400, *range(7)),
        pixel(3, 4, 0, 6000),
    )
    names = [type(message).__name__ for message in files.messages(path)]
    assert names == ["EventPacket", "Frame", "ImuPacket", "EventPacket"]


def test_a_frame_that_lacks_a_pixel_is_counted(tmp_path: Path) -> None:
    whole = frame(light(1), 100)
    torn = frame(light(2), 10_000)[: -8 * 100]
    lacking = whole[8:]
    for parts, count, missing in (
        ((torn, whole), 1, {"frames that are not whole": 1}),
        ((whole, torn), 1, {"frames that are not whole": 1}),
        ((lacking,), 0, {"frames that are not whole": 1}),
        ((whole[8 * 50_000 :], whole, whole), 2, {"APS words of no frame": 36_400}),
    ):
        path = written(tmp_path / "a.aedat", *parts, pixel(1, 1, 1, 50_000))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = files.summary(path)
        assert (found.frames, found.left_out) == (count, missing)


def test_imu_samples_are_in_the_cameras_axes(tmp_path: Path) -> None:
    # 1 g is 8192: at rest jAER reads -1 g along y, which points down
    parts = [imu(10, 0, -8192, 0, 0, 0, 0, 0), pixel(1, 1, 1, 11)]
    parts += [imu(12, 8192, 0, 4096, 340, 655, 1310, -655)]
    got = files.read(written(tmp_path / "a.aedat", *parts))
    assert got.stream.imu
    assert got.imu["t"].tolist() == [10, 12]
    np.testing.assert_allclose(got.imu["acceleration"][0], [0, -9.80665, 0])
    np.testing.assert_allclose(got.imu["acceleration"][1], np.array([-1, 0, -0.5]) * 9.80665)
    assert got.imu["temperature"].tolist() == [35, 36]
    np.testing.assert_allclose(
        got.imu["angular_velocity"][1], np.deg2rad([-10, 20, 10]), rtol=1e-12
    )


@pytest.mark.parametrize("step", [1, 2, 3, 5, 7, 8, 1000])
def test_imu_words_may_be_cut_anywhere(step: int) -> None:
    random = np.random.default_rng(5)
    data = b"".join(imu(t, *random.integers(-9, 9, 7).tolist()) for t in range(40))
    # a sample that lacks its fourth word, and a word too many
    data = data[: 8 * 73] + data[8 * 74 :] + data[8 * 6 : 8 * 7]
    words = np.frombuffer(data, [("address", ">u4"), ("stamp", ">i4")])
    address, t = words["address"].astype(np.int64), words["stamp"].astype(np.int64)
    taken = ImuAssembler()
    got = np.concatenate(
        [taken.feed(address[at : at + step], t[at : at + step]) for at in range(0, 280, step)]
    )
    taken.flush()
    assert got["t"].tolist() == [t for t in range(40) if t != 10]
    assert taken.lost == 7


@pytest.mark.parametrize("step", [1, 7, 20, 41, 1000])
def test_aps_words_may_be_cut_anywhere(step: int) -> None:
    random = np.random.default_rng(5)
    address, light_of = [], []
    for _ in range(9):
        places = [y << 22 | x << 12 for x in range(5) for y in range(4)]
        values = random.integers(0, 1000, 20)
        address += [APS | place | 1000 for place in places]
        address += [APS | place | SIGNAL | int(v) for place, v in zip(places, values, strict=True)]
        light_of.append(values)
    # the fourth frame lacks a word
    del address[3 * 40 + 25]
    t = np.arange(len(address))
    taken = FrameAssembler(5, 4, "eye")
    frames = []
    words = np.array(address, np.int64)
    for at in range(0, len(words), step):
        frames += list(taken.feed(words[at : at + step], t[at : at + step]))
    frames += list(taken.flush())
    assert (len(frames), taken.torn, taken.lost) == (8, 1, 0)
    assert [one.seq for one in frames] == list(range(8))
    for one, values in zip(frames, light_of[:3] + light_of[4:], strict=True):
        got = np.rint(one.pixels[::-1].T.reshape(-1) / 65535 * 1023)
        assert (got == 1000 - values).all()


@pytest.mark.parametrize("step", [1, 7, 1000])
def test_signals_of_a_frame_whose_resets_are_lost_leave_the_one_before_as_it_is(step: int) -> None:
    places = [y << 22 | x << 12 for x in range(5) for y in range(4)]
    resets = [APS | place | 1000 for place in places]
    signals, others = ([APS | place | SIGNAL | adc for place in places] for adc in (400, 900))
    words = np.array(resets + signals + others, np.int64)
    taken, frames = FrameAssembler(5, 4, "eye"), []
    for at in range(0, len(words), step):
        part = slice(at, at + step)
        frames += list(taken.feed(words[part], np.arange(len(words))[part]))
    frames += list(taken.flush())
    assert [(one.begin_us, one.end_us) for one in frames] == [(0, 39)]
    assert (np.rint(frames[0].pixels / 65535 * 1023) == 600).all()
    assert (taken.torn, taken.lost) == (0, 20)


def test_resets_of_one_pixel_for_ever_take_no_time() -> None:
    words = np.full(200_000, APS, np.int64)
    taken = FrameAssembler(640, 480, "eye")
    assert list(taken.feed(words, np.zeros(200_000, np.int64))) == []
    assert taken.torn == 199_999


def test_the_size_of_a_sensor_without_a_name_has_room_for_its_frames(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    path.write_bytes(b"#!AER-DAT2.0\r\n" + frame(light(1), 100) + pixel(1, 1, 1, 9000))
    stream = files.stream_of(path)
    assert (stream.width, stream.height, stream.frames) == (240, 180, True)
    with pytest.warns(ReadAsWarning, match="is read as davis240, since "):
        assert len(files.read(path).frames) == 1


def test_what_a_davis_recorded_becomes_aedat4_and_not_aedat2(tmp_path: Path) -> None:
    path = written(
        tmp_path / "a.aedat", frame(light(1), 100), imu(6000, *range(7)), pixel(1, 1, 1, 9000)
    )
    done = files.convert(path, tmp_path / "b.aedat4")
    assert (done.frames, done.imu_samples, done.events) == (1, 1, 1)
    assert files.read(tmp_path / "b.aedat4").frames == files.read(path).frames
    with pytest.raises(EvsError, match="cannot hold the intensity frames and IMU samples"):
        files.convert(tmp_path / "b.aedat4", tmp_path / "c.aedat")
    done = files.convert(path, tmp_path / "c.aedat", events_only=True)
    assert done.left_out == {"intensity frames": 1, "IMU samples": 1}
    assert not files.stream_of(tmp_path / "c.aedat").frames
