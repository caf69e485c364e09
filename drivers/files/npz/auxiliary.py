"""Frames, IMU samples, triggers and labels as plain arrays of an NPZ recording, and back."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any

import numpy as np

from evs.drivers.files.npz.columns import Arrays
from evs.drivers.files.recording_file import by_tick
from evs.msgs import (
    LABEL_DTYPE,
    TRIGGER_DTYPE,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
    empty_imu,
    empty_triggers,
)
from evs.msgs.frame import FRAME_ENCODINGS

Array = np.ndarray[Any, Any]

PIXELS = "frames"
"""(m, h, w) uint8 or uint16"""

STAMPS = {
    "frame_begin_us": "begin_us",
    "exposure_begin_us": "exposure_begin_us",
    "exposure_end_us": "exposure_end_us",
    "frame_end_us": "end_us",
}
"""array, (m,) int64 -> field of a Frame"""

IMU_ARRAYS = {
    "imu_t": ("t", "iu", 1),
    "imu_acceleration": ("acceleration", "f", 2),
    "imu_angular_velocity": ("angular_velocity", "f", 2),
    "imu_temperature": ("temperature", "f", 1),
}
"""array, (n,) or (n, 3) in IMU_DTYPE's units -> (its field, kinds of dtype, axes)"""

TRIGGER_ARRAYS = {"trigger_t": ("t", "iu"), "trigger_kind": ("kind", "iu")}
"""array, (n,) in TRIGGER_DTYPE's units -> (its field, kinds of dtype)"""

LABEL_ARRAYS = {
    "cause": ("u", 1, 0),
    "geom_id": ("i", 1, -1),
    "class_id": ("i", 1, -1),
    "depth": ("f", 1, np.nan),
    "flow": ("f", 2, np.nan),
}
"""array, (n,) or (n, 2) as the events -> (kinds of dtype, axes, value in files without it)"""

REQUIRED_LABELS = {"cause", "geom_id"}
"""without these, an archive has no labels"""

Get = Callable[[str, str, int], Array]
"""reads an array by its name, allowed kinds of dtype and number of axes"""


def arrays_of(
    frames: list[Frame], imu: list[ImuSamples], triggers: list[Triggers]
) -> dict[str, Array]:
    """The arrays to write, except the pixels, in their order; no array for an empty stream."""
    arrays: dict[str, Array] = {}
    if frames:
        for name, field in STAMPS.items():
            arrays[name] = np.array([getattr(frame, field) for frame in frames], np.int64)
    if imu:
        samples = np.concatenate(imu)
        for name, (field, _, _) in IMU_ARRAYS.items():
            arrays[name] = np.ascontiguousarray(samples[field])
    if triggers:
        found = np.concatenate(triggers)
        # those of one frame may end after the next one's begin
        found = found[np.argsort(found["t"], kind="stable")]
        for name, (field, _) in TRIGGER_ARRAYS.items():
            arrays[name] = np.ascontiguousarray(found[field])
    return arrays


def labels_of(names: Collection[str], get: Get, events: int) -> Labels | None:
    """The labels of an archive that has them; None where an array is missing or of another length.

    A value that is too large for its field raises ValueError.
    """
    if not set(names) >= REQUIRED_LABELS:
        return None
    labels = np.zeros(events, LABEL_DTYPE)
    for name, (kinds, axes, unknown) in LABEL_ARRAYS.items():
        if name not in names:
            labels[name] = unknown
            continue
        column = get(name, kinds, axes)
        if len(column) != events:
            return None
        if column.shape != labels[name].shape:
            raise ValueError(f"array '{name}' is {column.shape}, not {labels[name].shape}")
        labels[name] = column
        if not np.array_equal(labels[name], column, equal_nan=kinds == "f"):
            raise ValueError(f"array '{name}' has values that are no {name}")
    return labels


def frames_in(archive: Arrays, camera: str) -> Iterator[Frame]:
    """The frames of an archive that has these arrays, one by one; none where one is missing.

    Raises ValueError where they do not belong together.
    """
    if not {f"{name}.npy" for name in (PIXELS, *STAMPS)} <= set(archive.namelist()):
        return
    pixels = archive.column(PIXELS, "u", 3)
    stamps = {field: archive.column(name, "iu", 1).all() for name, field in STAMPS.items()}
    if pixels.dtype not in FRAME_ENCODINGS.values():
        raise ValueError(f"array '{PIXELS}' is {pixels.dtype}, not uint8 or uint16")
    if any(len(column) != pixels.left for column in stamps.values()):
        raise ValueError("frames and their stamps are not of one length")
    for seq in range(pixels.left):
        times = {field: int(column[seq]) for field, column in stamps.items()}
        yield Frame(seq, pixels=pixels.read(1)[0], camera=camera, **times)


def imu_of(names: Collection[str], get: Get) -> ImuSamples:
    """The IMU samples of an archive that has these arrays; none where one is missing.

    Raises ValueError where they do not belong together.
    """
    if not set(IMU_ARRAYS) <= set(names):
        return empty_imu()
    arrays = {field: get(name, kinds, axes) for name, (field, kinds, axes) in IMU_ARRAYS.items()}
    samples = empty_imu(len(arrays["t"]))
    for field, array in arrays.items():
        if array.shape != samples[field].shape:
            raise ValueError(f"the IMU's {field} is of shape {array.shape}")
        samples[field] = array
    if (samples["t"][1:] < samples["t"][:-1]).any():
        raise ValueError("the IMU's time stamps run backwards")
    return samples


def triggers_of(names: Collection[str], get: Get) -> Triggers:
    """The triggers of an archive that has these arrays; none where one is missing.

    Raises ValueError where they do not belong together.
    """
    if not set(TRIGGER_ARRAYS) <= set(names):
        return empty_triggers()
    arrays = {field: get(name, kinds, 1) for name, (field, kinds) in TRIGGER_ARRAYS.items()}
    found = np.zeros(len(arrays["t"]), TRIGGER_DTYPE)
    for field, array in arrays.items():
        if array.shape != found.shape:
            raise ValueError("triggers and their kinds are not of one length")
        found[field] = array
        if not np.array_equal(found[field], array):
            raise ValueError(f"the triggers' {field} has values that do not fit")
    if (found["t"][1:] < found["t"][:-1]).any():
        raise ValueError("the triggers' time stamps run backwards")
    return found


def merge_by_time(
    ticks: Iterable[Array],
    frames: Iterable[Frame],
    imu: ImuSamples,
    triggers: Triggers,
    stream: StreamInfo,
) -> Iterator[Array | Frame]:
    """Merge events, frames, IMU samples and triggers of each tick by time."""

    def end_us(t_us: int) -> int:
        return stream.start_us - (stream.start_us - t_us) // stream.tick_us * stream.tick_us

    def timed(parts: Iterable[Array], rank: int) -> Iterator[tuple[int, int, Array | Frame]]:
        return ((end_us(int(part["t"][-1])), rank, part) for part in parts)

    lanes = [
        ((end_us(frame.end_us), 0, frame) for frame in frames),
        timed(by_tick(triggers, stream), 1),
        timed(by_tick(imu, stream), 2),
        timed(ticks, 3),
    ]
    for _, _, message in heapq.merge(*lanes, key=lambda one: one[:2]):
        yield message
