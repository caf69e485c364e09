"""AEDAT4's frame and IMU packets: round trips of any values, and bytes that were changed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.files.aedat4.auxiliary import (
    FORMATS,
    OtherFormatError,
    frame_body,
    imu_body,
    parse_frame,
    parse_imu,
)
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.msgs import DEGREE, STANDARD_GRAVITY, Frame, empty_imu

pytestmark = pytest.mark.property

STAMPS = st.lists(st.integers(-(2**61), 2**61), min_size=4, max_size=4)
SINGLE = st.floats(-(2.0**100), 2.0**100, width=32)
CHANGES = st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=4)


@given(st.integers(1, 70), st.integers(1, 9), st.sampled_from(sorted(FORMATS)), STAMPS)
def test_any_frame_comes_back(width: int, height: int, kind: int, stamps: list[int]) -> None:
    random = np.random.default_rng(width)
    image = random.integers(0, 1 << 8 * FORMATS[kind].itemsize, (height, width))
    sent = Frame(5, *sorted(stamps), image.astype(FORMATS[kind]), "cam")
    assert parse_frame(frame_body(sent), 5, "cam") == sent


@given(st.lists(st.tuples(st.integers(-(2**61), 2**61), SINGLE, SINGLE, SINGLE), max_size=9))
def test_any_samples_of_a_device_come_back(rows: list[tuple[int, float, float, float]]) -> None:
    samples = empty_imu(len(rows))
    for sample, (t_us, force, turn, warmth) in zip(samples, sorted(rows), strict=True):
        sample["t"], sample["temperature"] = t_us, warmth
        sample["acceleration"] = force * STANDARD_GRAVITY, 0.0, -force * STANDARD_GRAVITY
        sample["angular_velocity"] = turn * DEGREE
    found = parse_imu(imu_body(samples))
    # a zero has lost its sign, since a default is not written
    assert (found == samples).all()


FRAME = frame_body(Frame(0, 10, 10, 20, 30, np.arange(48, dtype=np.uint8).reshape(6, 8), "cam"))
SAMPLES = empty_imu(4)
SAMPLES["t"] = 1, 2, 3, 4
SAMPLES["acceleration"] = 9.81
IMU = imu_body(SAMPLES)


@given(CHANGES, st.integers(0, 200))
def test_changed_frames_are_damage_or_keep_the_promises(
    changes: list[tuple[int, int]], cut: int
) -> None:
    body = bytearray(FRAME)
    for place, value in changes:
        body[place % len(body)] = value
    try:
        frame = parse_frame(bytes(body[: len(body) - cut]), 0, "cam")
    except (CorruptDataError, OtherFormatError):
        return
    assert frame.begin_us <= frame.exposure_begin_us <= frame.exposure_end_us <= frame.end_us
    assert frame.pixels.ndim == 2
    assert frame.pixels.size > 0
    int(frame.pixels.sum())


@given(CHANGES, st.integers(0, 200))
def test_changed_samples_are_damage_or_keep_the_promises(
    changes: list[tuple[int, int]], cut: int
) -> None:
    body = bytearray(IMU)
    for place, value in changes:
        body[place % len(body)] = value
    try:
        samples = parse_imu(bytes(body[: len(body) - cut]))
    except CorruptDataError:
        return
    assert list(samples["t"]) == sorted(samples["t"])
    assert np.isfinite(samples["acceleration"]).all()
