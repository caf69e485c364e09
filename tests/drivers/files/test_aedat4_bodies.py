"""Packet bodies of all four streams: any values come back; changed bytes are read or refused."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers.files.aedat4 import layout
from evs.drivers.files.aedat4.auxiliary import (
    OtherFormatError,
    frame_body,
    imu_body,
    parse_frame,
    parse_imu,
    parse_triggers,
    triggers_body,
)
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.msgs import (
    DEGREE,
    EVENT_DTYPE,
    STANDARD_GRAVITY,
    TRIGGER_DTYPE,
    Frame,
    empty_imu,
    make_triggers,
)
from reference.streams import random_events

pytestmark = pytest.mark.property

STAMPS = st.integers(-(2**62), 2**62)
QUICK, LONG = 1000, 25_000


@given(st.lists(st.tuples(STAMPS, st.integers(-128, 127)), max_size=40))
def test_any_triggers_come_back(marks: list[tuple[int, int]]) -> None:
    triggers = make_triggers(marks)
    assert parse_triggers(triggers_body(triggers)).tobytes() == triggers.tobytes()


@given(
    st.lists(STAMPS, min_size=4, max_size=4).map(sorted),
    st.integers(1, 70),
    st.integers(1, 20),
    st.sampled_from([np.uint8, np.uint16]),
    st.integers(0, 2**32),
)
def test_any_frame_comes_back(
    stamps: list[int], width: int, height: int, dtype: type, seed: int
) -> None:
    top = np.iinfo(dtype).max
    pixels = np.random.default_rng(seed).integers(0, top, (height, width), dtype, endpoint=True)
    begin, exposure_begin, exposure_end, end = stamps
    frame = Frame(7, begin, exposure_begin, exposure_end, end, pixels, "eye")
    assert parse_frame(frame_body(frame), 7, "eye") == frame


FLOATS = st.floats(-(2.0**100), 2.0**100, width=32)


@given(st.lists(st.tuples(STAMPS, st.lists(FLOATS, min_size=7, max_size=7)), max_size=20))
def test_any_imu_samples_come_back(rows: list[tuple[int, list[float]]]) -> None:
    samples = empty_imu(len(rows))
    for sample, (t_us, values) in zip(samples, sorted(rows, key=lambda row: row[0]), strict=True):
        sample["t"], sample["temperature"] = t_us, values[0]
        # what the format holds are float32 of g and degrees
        sample["acceleration"] = np.array(values[1:4]) * STANDARD_GRAVITY
        sample["angular_velocity"] = np.array(values[4:]) * DEGREE
    assert parse_imu(imu_body(samples)).tobytes() == samples.tobytes()


def valid_pixels(body: bytes) -> Any:
    """The pixels of a frame, which keeps what is promised of every frame."""
    frame = parse_frame(body, 0, "eye")
    assert frame.begin_us <= frame.exposure_begin_us <= frame.exposure_end_us <= frame.end_us
    assert frame.pixels.ndim == 2
    assert frame.pixels.size > 0
    int(frame.pixels.sum())
    return frame.pixels


def valid_samples(body: bytes) -> Any:
    """Samples, which keep what is promised of all samples."""
    samples = parse_imu(body)
    assert list(samples["t"]) == sorted(samples["t"])
    for name in ("temperature", "acceleration", "angular_velocity"):
        assert np.isfinite(samples[name]).all()
    return samples


def originals() -> dict[str, tuple[bytes, Callable[[bytes], Any]]]:
    """kind -> (a sound body, how it is read)"""
    random = np.random.default_rng(4)
    events = random_events(20, 0, 1000)
    image = random.integers(0, 256, (5, 7)).astype(np.uint8)
    samples = empty_imu(5)
    samples["t"] = np.arange(5)
    samples["acceleration"] = random.normal(size=(5, 3))
    marks = make_triggers((k, k) for k in range(10))
    return {
        "events": (layout.events_body(events), layout.parse_events),
        "frame": (
            frame_body(Frame(0, 1, 2, 3, 4, image)),
            valid_pixels,
        ),
        "imu": (imu_body(samples), valid_samples),
        "triggers": (triggers_body(marks), parse_triggers),
    }


def changed(body: bytes, random: np.random.Generator) -> bytes:
    """One to three changes: a byte, a whole number on the edge of something, a cut, a doubling."""
    data = bytearray(body)
    for _ in range(random.integers(1, 4)):
        at, how = int(random.integers(0, len(data) + 1)), random.integers(0, 5)
        if how == 0 and at < len(data):
            data[at] = random.integers(0, 256)
        elif how == 1:
            value = int(random.choice([0, 1, 7, 2**15, 2**31 - 1, 2**31, 2**32 - 1, len(body)]))
            data[at : at + 4] = value.to_bytes(4, "little")
        elif how == 2:
            del data[at:]
        elif how == 3:
            data[at:at] = data[at : at + int(random.integers(1, 60))]
        elif len(data) >= 4:
            # the size fits again, so that what lies behind it is reached
            data[:4] = (len(data) - 4).to_bytes(4, "little")
    return bytes(data)


def survive(kind: str, cases: int) -> None:
    body, parse = originals()[kind]
    random = np.random.default_rng(cases)
    read = refused = 0
    for _ in range(cases):
        data = changed(body, random)
        try:
            found = parse(data)
        except (CorruptDataError, OtherFormatError):
            refused += 1
            continue
        read += 1
        # nothing comes out that was not in the input
        assert found.nbytes <= 8 * len(data)
        assert found.dtype in (EVENT_DTYPE, TRIGGER_DTYPE, empty_imu().dtype, "u1", "<u2")
    assert read > cases // 100
    assert refused > cases // 100


@pytest.mark.parametrize("kind", ["events", "frame", "imu", "triggers"])
def test_changed_bodies_are_read_or_refused(kind: str) -> None:
    survive(kind, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["events", "frame", "imu", "triggers"])
def test_a_hundred_thousand_changed_bodies_are_read_or_refused(kind: str) -> None:
    survive(kind, LONG)


@settings(max_examples=300)
@given(st.binary(max_size=80), st.sampled_from(["events", "frame", "imu", "triggers"]))
def test_noise_is_refused_or_read(noise: bytes, kind: str) -> None:
    body, parse = originals()[kind]
    data = len(noise).to_bytes(4, "little") + noise[:4] + body[8:12] + noise[8:]
    with contextlib.suppress(CorruptDataError, OtherFormatError):
        assert parse(data).nbytes <= 8 * len(data)
