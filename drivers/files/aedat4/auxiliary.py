"""AEDAT4's frames, IMU samples and triggers as packet bodies, and back.

The names in dv-processing are FRME, IMUS and TRIG.
"""

from __future__ import annotations

from typing import Any

import flatbuffers
import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat4.layout import CorruptDataError, Flat, list_body
from evs.drivers.files.integrity import MAX_STAMP_US
from evs.msgs import (
    DEGREE,
    STANDARD_GRAVITY,
    Frame,
    ImuSamples,
    Triggers,
    empty_imu,
    empty_triggers,
)

_T = 0
"""slot of the time stamp in the table of a frame, of a sample and of a trigger"""

# the other slots of a frame
_BEGIN, _END, _EXPOSURE_BEGIN, _EXPOSURE_END = range(1, 5)
_FORMAT, _WIDTH, _HEIGHT, _LEFT, _TOP, _PIXELS, _EXPOSURE, _SOURCE = range(5, 13)
_FRAME_SLOTS = 13

FORMATS: dict[int, np.dtype[Any]] = {0: np.dtype("u1"), 2: np.dtype("<u2")}
"""OpenCV's type number of one grey channel -> dtype"""

_SENSOR = 1
"""FrameSource: as it came from the sensor"""

# the other slots of a sample: three axes each of two sensors, and a magnetometer after them
_TEMPERATURE, _ANGULAR_VELOCITY = 1, 5
_SAMPLE_SLOTS = 11

_KIND = 1
_TRIGGER_SLOTS = 2


class OtherFormatError(Exception):
    """A valid frame, but not one grey channel of 8 or 16 bits. Never reaches users."""


def frame_body(frame: Frame) -> bytes:
    """An uncompressed packet body. The frame's time stamp is the start of its exposure, as dv's."""
    pixels = np.ascontiguousarray(frame.pixels)
    number = next(key for key, dtype in FORMATS.items() if dtype == pixels.dtype)
    builder = flatbuffers.Builder(pixels.nbytes + 256)
    # a reader would take a stamp of 0 that is left out for one that the writer does not know
    builder.ForceDefaults(True)
    vector = builder.CreateNumpyVector(pixels.view(np.uint8).reshape(-1))
    builder.StartObject(_FRAME_SLOTS)
    for slot, value in (
        (_T, frame.exposure_begin_us),
        (_BEGIN, frame.begin_us),
        (_END, frame.end_us),
        (_EXPOSURE_BEGIN, frame.exposure_begin_us),
        (_EXPOSURE_END, frame.exposure_end_us),
        (_EXPOSURE, frame.exposure_end_us - frame.exposure_begin_us),
    ):
        builder.PrependInt64Slot(slot, value, 0)
    builder.PrependUOffsetTRelativeSlot(_PIXELS, vector, 0)
    builder.PrependInt16Slot(_WIDTH, frame.width, 0)
    builder.PrependInt16Slot(_HEIGHT, frame.height, 0)
    if frame.is_region:
        builder.PrependInt16Slot(_LEFT, frame.left, 0)
        builder.PrependInt16Slot(_TOP, frame.top, 0)
    builder.PrependInt8Slot(_FORMAT, number, 0)
    builder.PrependInt8Slot(_SOURCE, _SENSOR, 0)
    builder.FinishSizePrefixed(builder.EndObject(), file_identifier=b"FRME")
    return bytes(builder.Output())


def parse_frame(body: bytes, seq: int, camera: str) -> Frame:
    """The frame of an uncompressed packet body, its pixels a read-only view of its bytes.

    Stamps that another writer leaves out are the exposure's, and those of the exposure the frame's.

    Raises:
        CorruptDataError: The bytes are not a frame.
        OtherFormatError: The frame is in colour.
    """
    flat = Flat(body, b"FRME")
    table = flat.root()

    def number(field: int, kind: str, default: int) -> int:
        at = flat.field(table, field)
        return default if at is None else flat.number(kind, at)

    t_us = number(_T, "<q", 0)
    exposure_begin = number(_EXPOSURE_BEGIN, "<q", t_us)
    exposure_end = number(_EXPOSURE_END, "<q", exposure_begin + number(_EXPOSURE, "<q", 0))
    begin = number(_BEGIN, "<q", exposure_begin)
    end = number(_END, "<q", exposure_end)
    if not begin <= exposure_begin <= exposure_end <= end:
        raise CorruptDataError(f"frame's stamps {begin} ... {end} us run backwards")
    width, height = number(_WIDTH, "<h", 0), number(_HEIGHT, "<h", 0)
    kind, at = number(_FORMAT, "<b", 0), flat.field(table, _PIXELS)
    if width < 1 or height < 1 or at is None:
        raise CorruptDataError(f"frame of {width} x {height} px")
    if kind not in FORMATS:
        raise OtherFormatError
    start, length = flat.vector(at, 1)
    if length != width * height * FORMATS[kind].itemsize:
        raise CorruptDataError(f"frame of {width} x {height} px has {length} bytes")
    pixels = np.frombuffer(body, FORMATS[kind], width * height, start).reshape(height, width)
    left, top = number(_LEFT, "<h", 0), number(_TOP, "<h", 0)
    return Frame(seq, begin, exposure_begin, exposure_end, end, pixels, camera, left, top)


def imu_body(samples: ImuSamples) -> bytes:
    """An uncompressed packet body: float32 in g, degrees/s and degrees C.

    It holds the values of our sensors without loss.
    """
    force = (samples["acceleration"] / STANDARD_GRAVITY).astype(np.float32)
    turn = (samples["angular_velocity"] / DEGREE).astype(np.float32)
    values = np.hstack([samples["temperature"][:, np.newaxis].astype(np.float32), force, turn])
    builder = flatbuffers.Builder(96 * len(samples) + 256)
    # -0.0 counts as the default, and would come back as 0.0
    builder.ForceDefaults(True)
    tables = []
    for t_us, row in zip(samples["t"].tolist(), values.tolist(), strict=True):
        builder.StartObject(_SAMPLE_SLOTS)
        builder.PrependInt64Slot(_T, t_us, 0)
        for slot, value in enumerate(row, _TEMPERATURE):
            builder.PrependFloat32Slot(slot, value, 0.0)
        tables.append(builder.EndObject())
    return list_body(builder, tables, b"IMUS")


def parse_imu(body: bytes) -> ImuSamples:
    """The samples of an uncompressed packet body, in SI units. Raises CorruptDataError."""
    flat = Flat(body, b"IMUS")
    # a sample takes its place in the list, its stamp, and a link to the layout of its fields
    start, count = _elements(flat, 16, "IMU samples", len(body))
    samples = empty_imu(count)
    for row in range(count):
        at = start + 4 * row
        table = at + flat.number("<I", at)
        t_at = flat.field(table, _T)
        samples["t"][row] = 0 if t_at is None else flat.number("<q", t_at)
        values = []
        for field in range(_TEMPERATURE, _ANGULAR_VELOCITY + 3):
            value_at = flat.field(table, field)
            values.append(0.0 if value_at is None else flat.real(value_at))
        samples["temperature"][row] = values[0]
        samples["acceleration"][row] = values[1:4]
        samples["angular_velocity"][row] = values[4:7]
    samples["acceleration"] *= STANDARD_GRAVITY
    samples["angular_velocity"] *= DEGREE
    _check_stamps(samples["t"], "the IMU's")
    for key in ("temperature", "acceleration", "angular_velocity"):
        if not np.isfinite(samples[key]).all():
            raise CorruptDataError("an IMU sample has a value that is not finite")
    return samples


def triggers_body(triggers: Triggers) -> bytes:
    """An uncompressed packet body."""
    builder = flatbuffers.Builder(32 * len(triggers) + 64)
    tables = []
    for t_us, kind in triggers.tolist():
        builder.StartObject(_TRIGGER_SLOTS)
        builder.PrependInt64Slot(_T, t_us, 0)
        builder.PrependInt8Slot(_KIND, kind, 0)
        tables.append(builder.EndObject())
    return list_body(builder, tables, b"TRIG")


def parse_triggers(body: bytes) -> Triggers:
    """The triggers of an uncompressed packet body. Raises CorruptDataError."""
    flat = Flat(body, b"TRIG")
    # a trigger takes its place in the list and a link to the layout of its fields
    start, count = _elements(flat, 8, "triggers", len(body))
    triggers = empty_triggers(count)
    for row in range(count):
        at = start + 4 * row
        table = at + flat.number("<I", at)
        for name, field, kind in (("t", _T, "<q"), ("kind", _KIND, "<b")):
            value_at = flat.field(table, field)
            triggers[name][row] = 0 if value_at is None else flat.number(kind, value_at)
    _check_stamps(triggers["t"], "the triggers'")
    return triggers


def _elements(flat: Flat, least_bytes: int, what: str, size: int) -> tuple[int, int]:
    """Where the list of a body begins, and the number of its elements; 0, 0 without a list.

    Args:
        flat: The body.
        least_bytes: Least bytes of an element.
        what: What the elements are called.
        size: Size of the body, bytes.

    Raises:
        CorruptDataError: The body is too small for so many elements.
    """
    elements_at = flat.field(flat.root(), 0)
    if elements_at is None:
        return 0, 0
    start, count = flat.vector(elements_at, 4)
    if least_bytes * count > size:
        raise CorruptDataError(f"{count} {what} do not fit a buffer of {size} bytes")
    return start, count


def _check_stamps(stamps: npt.NDArray[np.int64], whose: str) -> None:
    beyond = (stamps < -MAX_STAMP_US) | (stamps > MAX_STAMP_US)
    if beyond.any() or (stamps[1:] < stamps[:-1]).any():
        raise CorruptDataError(f"{whose} time stamps run backwards or are beyond 2^62 us")
