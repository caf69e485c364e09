"""ImuPacket: the samples of a camera's accelerometer and gyroscope.

The axes are the camera's optical ones, as ROS (REP 103) has them: x right, y down, z forward. At
rest, upright, the acceleration is (0, -9.81, 0): the force that holds the camera points up.
On the wire: `topic | msgpack header | raw frame`, see docs/reference/wire.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evs.msgs.header_fields import MAX_INT64, MessageError, integer, name, shown
from evs.msgs.packet import packb, plain_integers, unpackb

IMU_DTYPE = np.dtype(
    [
        ("t", "<i8"),
        ("acceleration", "<f8", (3,)),
        ("angular_velocity", "<f8", (3,)),
        ("temperature", "<f8"),
    ]
)
"""t int64 us of simulated time; proper acceleration, m/s^2; angular velocity, rad/s; degrees C."""

STANDARD_GRAVITY = 9.80665
"""m/s^2: makers give accelerometers in multiples of it, and AEDAT4 holds them so."""

DEGREE = math.pi / 180.0
"""rad: the unit of AEDAT4's gyroscopes."""

IMU_ENCODING = "evs_imu64"
"""Name of the raw frame's encoding: an array of IMU_DTYPE, little-endian, 64 bytes a sample."""

ImuSamples = np.ndarray[Any, np.dtype[np.void]]
"""(n,) IMU_DTYPE, sorted by t."""


def empty_imu(count: int = 0) -> ImuSamples:
    """`count` zeroed samples."""
    return np.zeros(count, IMU_DTYPE)


@dataclass(frozen=True, eq=False)
class ImuPacket:
    """The samples of one tick (or more) of one camera."""

    seq: int
    """Counts this camera's IMU packets from 0, without gaps."""
    samples: ImuSamples = field(default_factory=empty_imu)
    """(n,) IMU_DTYPE, sorted by t."""
    camera: str = "camera"
    """Name of the camera that measured them."""

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        return f"<ImuPacket {self.seq} of '{self.camera}': {len(self)} samples>"

    def __eq__(self, other: object) -> bool:
        """Same name and number, same bytes."""
        if not isinstance(other, ImuPacket):
            return NotImplemented
        same = self.samples.tobytes() == other.samples.tobytes()
        return (self.seq, self.camera) == (other.seq, other.camera) and same

    __hash__ = None  # type: ignore[assignment]


def encode_imu(packet: ImuPacket) -> tuple[bytes, memoryview]:
    """Encode a packet.

    Returns:
        The msgpack header, and the raw frame of 64 n bytes.

    Raises:
        MessageError: `decode_imu` would refuse the packet.
    """
    if packet.samples.dtype != IMU_DTYPE or packet.samples.ndim != 1:
        raise MessageError("IMU samples are not an (n,) array of IMU_DTYPE: use empty_imu(n)")
    header = plain_integers(
        {
            "seq": packet.seq,
            "encoding": IMU_ENCODING,
            "is_bigendian": False,
            "camera": packet.camera,
        }
    )
    _checked(header)
    _check_samples(packet.samples)
    samples = np.ascontiguousarray(packet.samples)
    return packb(header), samples.view(np.uint8).reshape(-1).data


def decode_imu(header: bytes, raw: Any) -> ImuPacket:
    """Decode a packet.

    Args:
        header: The msgpack header.
        raw: Any contiguous buffer with the samples, whose memory the packet shares.

    Raises:
        MessageError: The bytes do not fit the format, time steps back, or a value is not finite.
    """
    fields = _checked(unpackb(header))
    size = memoryview(raw).nbytes
    if size % IMU_DTYPE.itemsize:
        raise MessageError(f"raw frame of {size} bytes is not whole IMU samples")
    samples = np.frombuffer(raw, IMU_DTYPE)
    _check_samples(samples)
    return ImuPacket(fields["seq"], samples, fields["camera"])


def _check_samples(samples: ImuSamples) -> None:
    if (samples["t"][1:] < samples["t"][:-1]).any():
        raise MessageError("IMU samples are not sorted by t")
    if not all(np.isfinite(samples[key]).all() for key in (IMU_DTYPE.names or ())[1:]):
        raise MessageError("an IMU sample has a value that is not finite")


def _checked(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a header, every value of the right type and in its range."""
    if fields.get("encoding") != IMU_ENCODING:
        raise MessageError(f"IMU encoding {shown(fields.get('encoding'))} is not {IMU_ENCODING!r}")
    if fields.get("is_bigendian") is not False:
        raise MessageError("IMU packet is not marked little-endian (is_bigendian: false)")
    integer(fields, "seq", 0, MAX_INT64)
    name(fields, "camera")
    return fields
