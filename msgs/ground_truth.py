"""Truth: depth, normal, geom, motion and more at each pixel's centre.

On the wire: `topic | msgpack header | raw frame`, see docs/reference/wire.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.msgs.header_fields import MAX_INT64, MAX_PIXELS, MessageError, integer, name
from evs.msgs.packet import packb, plain_integers, unpackb

Channel = np.ndarray[Any, np.dtype[Any]]

TRUTH_CHANNELS: dict[str, tuple[np.dtype[Any], int]] = {
    "depth": (np.dtype("<f4"), 1),
    "distance": (np.dtype("<f4"), 1),
    "normal": (np.dtype("<f4"), 3),
    "position": (np.dtype("<f4"), 3),
    "geom_id": (np.dtype("<i4"), 1),
    "body_id": (np.dtype("<i4"), 1),
    "flow": (np.dtype("<f4"), 2),
}
"""Channel -> dtype and numbers a pixel. All are 4 bytes; a raw frame holds them in this order."""

TRUTH_ENCODING = "evs_truth48"
"""Name of the raw frame's encoding: the channels' planes, one after the other, 48 bytes a pixel."""

_PIXEL_BYTES = sum(kind.itemsize * count for kind, count in TRUTH_CHANNELS.values())


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of one instant. Units and frames are those of evs.emulator's GroundTruth."""

    seq: int
    """Counts this camera's messages of ground truth from 0."""
    t_us: int
    """Simulated time, us."""
    channels: dict[str, Channel]
    """Every one of TRUTH_CHANNELS: (h, w), or (h, w, n) where n numbers belong to a pixel."""
    camera: str = "camera"
    """Name of the camera."""

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.channels["depth"].shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.channels["depth"].shape[1])


def encode_truth(truth: Truth) -> tuple[bytes, memoryview]:
    """Encode ground truth.

    Returns:
        The msgpack header, and the raw frame of 48 h w bytes.

    Raises:
        MessageError: `decode_truth` would refuse the message.
    """
    if set(truth.channels) != set(TRUTH_CHANNELS):
        raise MessageError(f"ground truth has to hold all of: {', '.join(TRUTH_CHANNELS)}")
    height, width = truth.height, truth.width
    planes = []
    for key, (kind, count) in TRUTH_CHANNELS.items():
        plane = np.ascontiguousarray(truth.channels[key], kind)
        if plane.shape != _shape(height, width, count):
            raise MessageError(f"ground truth's {key} has another shape than its depth")
        planes.append(plane.reshape(-1).view(np.uint8))
    header = plain_integers(
        {
            "seq": truth.seq,
            "t": truth.t_us,
            "encoding": TRUTH_ENCODING,
            "is_bigendian": False,
            "width": width,
            "height": height,
            "camera": truth.camera,
        }
    )
    _checked(header)
    return packb(header), np.concatenate(planes).data


def decode_truth(header: bytes, raw: Any) -> Truth:
    """Decode ground truth. Infinity and NaN are valid values.

    Args:
        header: The msgpack header.
        raw: Any contiguous buffer with the channels, whose memory the result shares.

    Raises:
        MessageError: The bytes do not fit the format.
    """
    fields = _checked(unpackb(header))
    height, width = fields["height"], fields["width"]
    size = memoryview(raw).nbytes
    if size != height * width * _PIXEL_BYTES:
        raise MessageError(f"raw frame of {size} bytes is not {width}x{height} x {_PIXEL_BYTES}")
    channels, begin = {}, 0
    for key, (kind, count) in TRUTH_CHANNELS.items():
        found = np.frombuffer(raw, kind, height * width * count, begin)
        channels[key] = found.reshape(_shape(height, width, count))
        begin += found.nbytes
    return Truth(fields["seq"], fields["t"], channels, fields["camera"])


def _shape(height: int, width: int, count: int) -> tuple[int, ...]:
    return (height, width) if count == 1 else (height, width, count)


def _checked(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a header, every value of the right type and in its range."""
    if fields.get("encoding") != TRUTH_ENCODING or fields.get("is_bigendian") is not False:
        raise MessageError(f"ground truth is not marked {TRUTH_ENCODING!r}, little-endian")
    integer(fields, "seq", 0, MAX_INT64)
    integer(fields, "t", -MAX_INT64, MAX_INT64)
    integer(fields, "width", 1, MAX_PIXELS)
    integer(fields, "height", 1, MAX_PIXELS)
    name(fields, "camera")
    return fields
