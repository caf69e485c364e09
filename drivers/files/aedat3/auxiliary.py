"""Frames and IMU samples in AEDAT3.1's packets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from evs.drivers.files.aedat3.compressed import MAX_DEFLATE, MAX_PICTURE_BYTES, PNG_BIT
from evs.drivers.files.aedat3.layout import FRAME_HEAD, IMU, SPAN_US, Head
from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.msgs import DEGREE, STANDARD_GRAVITY, Frame, ImuSamples, empty_imu


class BadEventError(Exception):
    """The bytes are not a frame. Never reaches users."""


class ColouredError(Exception):
    """The frame is in colour. Never reaches users."""


def samples_in(body: bytes, head: Head) -> tuple[ImuSamples, int, int]:
    """The valid samples of a packet, sorted; how many are marked invalid, how many are corrupt."""
    rows = np.frombuffer(body, IMU[head.kind], len(body) // head.size)
    valid = (rows["info"] & 1) != 0
    samples = empty_imu(len(rows))
    samples["t"] = (head.overflow << 31) + rows["stamp"].astype(np.int64)
    samples["temperature"] = rows["temperature"]
    sound = rows["stamp"] >= 0
    with np.errstate(invalid="ignore", over="ignore"):
        samples["acceleration"] = rows["acceleration"].astype(np.float64) * STANDARD_GRAVITY
        samples["angular_velocity"] = rows["angular_velocity"].astype(np.float64) * DEGREE
    for name in ("temperature", "acceleration", "angular_velocity"):
        finite = np.isfinite(samples[name])
        sound &= finite if finite.ndim == 1 else finite.all(1)
    kept = samples[valid & sound]
    bad = int(np.count_nonzero(valid & ~sound))
    return kept[np.argsort(kept["t"], kind="stable")], int(np.count_nonzero(~valid)), bad


def frames_in(
    file: BinaryIO, at: int, head: Head
) -> Iterator[Frame | BadEventError | ColouredError | None]:
    """Read the frames of a packet one at a time.

    Args:
        file: The file.
        at: Byte offset of the first frame.
        head: The packet's header.

    Yields:
        A frame; None for one that is marked invalid; an error for one that is corrupt or in colour.
        After a BadEventError of a compressed packet nothing follows.
    """
    end = at + head.length
    for _ in range(head.number):
        file.seek(at)
        head_bytes = file.read(FRAME_HEAD.size) if at + FRAME_HEAD.size <= end else b""
        if len(head_bytes) < FRAME_HEAD.size:
            yield BadEventError("its frames do not fit into it")
            return
        info, *numbers = FRAME_HEAD.unpack(head_bytes)
        width, height = numbers[4:6]
        channels, size = info >> 1 & 7, 2 * width * height
        possible = 0 < min(width, height) <= max(width, height) <= MAX_SIDE_PX
        if head.compressed and info & PNG_BIT:
            packed = int.from_bytes(file.read(4), "little")
            begin, step = at + FRAME_HEAD.size + 4, FRAME_HEAD.size + 4 + packed
        else:
            packed, begin = -1, at + FRAME_HEAD.size
            step = FRAME_HEAD.size + size * channels if head.compressed else head.size
        if not info & 1 and not head.compressed:
            yield None
        elif not possible or at + step > end or FRAME_HEAD.size + size > head.size:
            yield BadEventError(f"a frame of {width} x {height} px does not fit into it")
            if head.compressed:
                return
        elif not info & 1:
            yield None
        elif channels != 1:
            yield ColouredError()
        else:
            file.seek(begin)
            data = file.read(size if packed < 0 else packed)
            found = _frame(data, head, numbers[:4], (width, height), packed >= 0)
            left, top = numbers[6:8]
            if max(abs(left), abs(top)) >= MAX_SIDE_PX:
                yield BadEventError(f"a frame begins at ({left}, {top}) px")
            elif isinstance(found, Frame):
                yield replace(found, left=left, top=top)
            else:
                yield found
        at += step


def _frame(
    data: bytes, head: Head, stamps: list[int], sides: tuple[int, int], packed: bool
) -> Frame | BadEventError:
    """Decode a frame; `stamps` are start and end of the frame, then of its exposure."""
    # what is lower than its begin came after a wrap of the clock
    begin, end, exposure_begin, exposure_end = (
        (head.overflow << 31) + stamp + (SPAN_US if stamp < stamps[0] else 0) for stamp in stamps
    )
    if min(stamps) < 0 or not begin <= exposure_begin <= exposure_end <= end:
        return BadEventError(f"a frame's stamps {stamps} us run backwards")
    width, height = sides
    pixels = _unpacked(data, *sides) if packed else np.frombuffer(data, "<u2")
    if pixels is None or pixels.size != width * height:
        return BadEventError(f"a frame of {width} x {height} px has no such picture")
    shaped = pixels.reshape(height, width)
    return Frame(0, begin, exposure_begin, exposure_end, end, shaped)


def _unpacked(data: bytes, width: int, height: int) -> npt.NDArray[np.uint16] | None:
    from evs.drivers.pictures.image_files import grey_png

    if 2 * width * height > min(MAX_PICTURE_BYTES, MAX_DEFLATE * (len(data) + 64)):
        return None
    return grey_png(data, width, height)
