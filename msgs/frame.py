"""Frame: one intensity image of a camera with active pixels (APS) in addition to event pixels.

On the wire: `topic | msgpack header | raw frame`, see docs/reference/wire.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.msgs.header_fields import MAX_INT64, MAX_PIXELS, MessageError, integer, name, shown
from evs.msgs.packet import packb, plain_integers, unpackb

Pixels = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

FRAME_ENCODINGS: dict[str, np.dtype[Any]] = {"mono8": np.dtype("u1"), "mono16": np.dtype("<u2")}
"""Name of the raw frame's encoding, as ROS's sensor_msgs/Image has it -> dtype of a pixel."""

_STAMPS = ("begin", "exposure_begin", "exposure_end", "end")


@dataclass(frozen=True, eq=False)
class Frame:
    """An image and the times of its exposure, stamped like AEDAT4's frames in simulated time.

    With a rolling shutter the exposure is that of the first row.
    """

    seq: int
    """Counts this camera's frames from 0, without gaps."""
    begin_us: int
    """Start of the frame, us: the first row begins to collect light."""
    exposure_begin_us: int
    """Start of the exposure, us."""
    exposure_end_us: int
    """End of the exposure, us."""
    end_us: int
    """End of the frame, us: the last row has been read out."""
    pixels: Pixels
    """(h, w) uint8 or uint16, in proportion to the light; the largest number is white."""
    camera: str = "camera"
    """Name of the camera that saw it."""
    left: int = 0
    """Column of the sensor that its first column is: recordings may hold frames of a region."""
    top: int = 0
    """Row of the sensor that its first row is."""

    @property
    def is_region(self) -> bool:
        """Whether it is a region that does not begin in the sensor's corner."""
        return bool(self.left or self.top)

    def on_sensor(self, width: int, height: int) -> Frame:
        """The frame at its position on a sensor of this size, px, black outside its region."""
        if not self.is_region:
            return self
        pixels = np.zeros((height, width), self.pixels.dtype)
        first, last = max(0, self.top), min(height, self.top + self.height)
        begin, end = max(0, self.left), min(width, self.left + self.width)
        if first < last and begin < end:
            seen = self.pixels[first - self.top : last - self.top]
            pixels[first:last, begin:end] = seen[:, begin - self.left : end - self.left]
        return replace(self, pixels=pixels, left=0, top=0)

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.pixels.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.pixels.shape[1])

    def __repr__(self) -> str:
        when = f"exposed {self.exposure_begin_us} ... {self.exposure_end_us} us"
        size = f"{self.width} x {self.height} {self.pixels.dtype}"
        return f"<Frame {self.seq} of '{self.camera}', {size}, {when}>"

    def __eq__(self, other: object) -> bool:
        """Same stamps, same name, same pixels of the same type in the same place."""
        if not isinstance(other, Frame):
            return NotImplemented
        mine, others = (
            (*(getattr(one, f"{key}_us") for key in _STAMPS), *_facts(one)) for one in (self, other)
        )
        same = self.pixels.dtype == other.pixels.dtype
        return mine == others and same and bool(np.array_equal(self.pixels, other.pixels))

    __hash__ = None  # type: ignore[assignment]


def _facts(frame: Frame) -> tuple[int, str, int, int]:
    return frame.seq, frame.camera, frame.left, frame.top


def encode_frame(frame: Frame) -> tuple[bytes, memoryview]:
    """Encode a frame.

    Returns:
        The msgpack header, and the raw frame: the rows of pixels, top first, little-endian.

    Raises:
        MessageError: `decode_frame` would refuse the frame.
    """
    pixels = np.asarray(frame.pixels)
    names = [key for key, kind in FRAME_ENCODINGS.items() if kind == pixels.dtype]
    if pixels.ndim != 2 or not names:
        raise MessageError(f"frame is {pixels.dtype} of shape {pixels.shape}, not (h, w) uint8/16")
    header: dict[str, Any] = {
        "seq": frame.seq,
        **{key: getattr(frame, f"{key}_us") for key in _STAMPS},
        "encoding": names[0],
        "is_bigendian": False,
        "width": frame.width,
        "height": frame.height,
        "camera": frame.camera,
    }
    header = plain_integers(header)
    _checked(header)
    return packb(header), np.ascontiguousarray(pixels).view(np.uint8).reshape(-1).data


def decode_frame(header: bytes, raw: Any) -> Frame:
    """Decode a frame.

    Args:
        header: The msgpack header.
        raw: Any contiguous buffer with the pixels, whose memory the frame shares.

    Raises:
        MessageError: The bytes do not fit the format.
    """
    fields = _checked(unpackb(header))
    shape, dtype = (fields["height"], fields["width"]), FRAME_ENCODINGS[fields["encoding"]]
    size = memoryview(raw).nbytes
    if size != shape[0] * shape[1] * dtype.itemsize:
        raise MessageError(f"raw frame of {size} bytes is not {shape[1]}x{shape[0]} {dtype}")
    return Frame(
        seq=fields["seq"],
        pixels=np.frombuffer(raw, dtype).reshape(shape),
        camera=fields["camera"],
        **{f"{key}_us": fields[key] for key in _STAMPS},
    )


def _checked(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a frame's header, every value of the right type and in its range."""
    encoding = fields.get("encoding")
    if not isinstance(encoding, str) or encoding not in FRAME_ENCODINGS:
        known = " or ".join(FRAME_ENCODINGS)
        raise MessageError(f"frame encoding {shown(encoding)} is not {known}")
    if fields.get("is_bigendian") is not False:
        raise MessageError("frame is not marked little-endian (is_bigendian: false)")
    integer(fields, "seq", 0, MAX_INT64)
    stamps = [integer(fields, key, -MAX_INT64, MAX_INT64) for key in _STAMPS]
    if stamps != sorted(stamps):
        raise MessageError(f"frame's stamps {stamps} us run backwards")
    integer(fields, "width", 1, MAX_PIXELS)
    integer(fields, "height", 1, MAX_PIXELS)
    name(fields, "camera")
    return fields
