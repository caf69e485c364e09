"""AEDAT4's IMU packets ("IMUS" of dv-processing): float32 in g, degrees/s and degrees C."""

from __future__ import annotations

import flatbuffers
import numpy as np

from evs.drivers.files.aedat4.layout import CorruptDataError, Flat, list_body
from evs.drivers.files.integrity import MAX_STAMP_US
from evs.msgs import DEGREE, STANDARD_GRAVITY, ImuSamples, empty_imu

# fields of a sample's table: t, temperature, three axes each of two sensors and a magnetometer
_T, _TEMPERATURE, _ACCELERATION, _TURN = 0, 1, 2, 5
_FIELDS = 11


def imu_body(samples: ImuSamples) -> bytes:
    """An uncompressed packet body. It holds the values of our sensors without loss."""
    force = (samples["acceleration"] / STANDARD_GRAVITY).astype(np.float32)
    turn = (samples["angular_velocity"] / DEGREE).astype(np.float32)
    values = np.hstack([samples["temperature"][:, np.newaxis].astype(np.float32), force, turn])
    builder = flatbuffers.Builder(96 * len(samples) + 256)
    # -0.0 counts as the default, and would come back as 0.0
    builder.ForceDefaults(True)
    tables = []
    for t_us, row in zip(samples["t"].tolist(), values.tolist(), strict=True):
        builder.StartObject(_FIELDS)
        builder.PrependInt64Slot(_T, t_us, 0)
        for slot, value in enumerate(row, _TEMPERATURE):
            builder.PrependFloat32Slot(slot, value, 0.0)
        tables.append(builder.EndObject())
    return list_body(builder, tables, b"IMUS")


def parse_imu(body: bytes) -> ImuSamples:
    """The samples of an uncompressed packet body, SI. Raises CorruptDataError."""
    flat = Flat(body, b"IMUS")
    elements_at = flat.field(flat.root(), 0)
    if elements_at is None:
        return empty_imu()
    start, count = flat.vector(elements_at, 4)
    # a sample takes its place in the list, its stamp, and a link to the layout of its fields
    if 16 * count > len(body):
        raise CorruptDataError(f"{count} IMU samples do not fit a buffer of {len(body)} bytes")
    samples = empty_imu(count)
    for row in range(count):
        at = start + 4 * row
        table = at + flat.number("<I", at)
        t_at = flat.field(table, _T)
        samples["t"][row] = 0 if t_at is None else flat.number("<q", t_at)
        values = []
        for field in range(_TEMPERATURE, _TURN + 3):
            value_at = flat.field(table, field)
            values.append(0.0 if value_at is None else flat.real(value_at))
        samples["temperature"][row] = values[0]
        samples["acceleration"][row] = values[1:4]
        samples["angular_velocity"][row] = values[4:7]
    samples["acceleration"] *= STANDARD_GRAVITY
    samples["angular_velocity"] *= DEGREE
    _check(samples)
    return samples


def _check(samples: ImuSamples) -> None:
    stamps = samples["t"]
    beyond = (stamps < -MAX_STAMP_US) | (stamps > MAX_STAMP_US)
    if beyond.any() or (stamps[1:] < stamps[:-1]).any():
        raise CorruptDataError("the IMU's time stamps run backwards or are beyond 2^62 us")
    for key in ("temperature", "acceleration", "angular_velocity"):
        if not np.isfinite(samples[key]).all():
            raise CorruptDataError("an IMU sample has a value that is not finite")
