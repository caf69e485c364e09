"""AEDAT4's frame packets ("FRME" of dv-processing): one intensity image each."""

from __future__ import annotations

from typing import Any

import flatbuffers
import numpy as np

from evs.drivers.files.aedat4.layout import CorruptDataError, Flat
from evs.msgs import Frame

# fields of the table, in their order
_T, _BEGIN, _END, _EXPOSURE_BEGIN, _EXPOSURE_END = range(5)
_FORMAT, _WIDTH, _HEIGHT, _LEFT, _TOP, _PIXELS, _EXPOSURE, _SOURCE = range(5, 13)
_FIELDS = 13

FORMATS: dict[int, np.dtype[Any]] = {0: np.dtype("u1"), 2: np.dtype("<u2")}
"""OpenCV's type number of one grey channel -> dtype."""

_SENSOR = 1
"""FrameSource: as it came from the sensor."""


class OtherFormatError(Exception):
    """A valid frame, but not one grey channel of 8 or 16 bits. Never reaches users."""


def frame_body(frame: Frame) -> bytes:
    """An uncompressed packet body. The frame's time stamp is the start of its exposure, as dv's."""
    pixels = np.ascontiguousarray(frame.pixels)
    number = next(key for key, dtype in FORMATS.items() if dtype == pixels.dtype)
    builder = flatbuffers.Builder(pixels.nbytes + 256)
    # a stamp of 0 that is left out would be taken for one that another writer has none of
    builder.ForceDefaults(True)
    vector = builder.CreateNumpyVector(pixels.view(np.uint8).reshape(-1))
    builder.StartObject(_FIELDS)
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
    return Frame(seq, begin, exposure_begin, exposure_end, end, pixels, camera)
