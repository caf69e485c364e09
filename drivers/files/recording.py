"""Recording: events with all that was recorded with them; what recorders and readers share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.formats import ANYTHING, SUFFIXES, Holds
from evs.msgs import (
    EVENT_DTYPE,
    IMU_DTYPE,
    TRIGGER_DTYPE,
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
    empty_imu,
    empty_triggers,
    nearest_first,
)


class Beside:
    """What was recorded beside the events, read when it is first asked for."""

    def __init__(
        self,
        load: Callable[[], Iterable[Frame | ImuSamples | Triggers]],
        labels: Labels | None = None,
    ) -> None:
        """In: load, reads frames, IMU samples, triggers; labels of all events, if there are any."""
        self._load, self.labels = load, labels

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """In the order recorded."""
        return tuple(one for one in self._all if isinstance(one, Frame))

    @cached_property
    def imu(self) -> ImuSamples:
        """(n,) IMU_DTYPE."""
        return np.concatenate([empty_imu(), *self._of(IMU_DTYPE)])

    @cached_property
    def triggers(self) -> Triggers:
        """(n,) TRIGGER_DTYPE."""
        return np.concatenate([empty_triggers(), *self._of(TRIGGER_DTYPE)])

    def _of(self, dtype: np.dtype[Any]) -> list[ImuSamples | Triggers]:
        return [one for one in self._all if not isinstance(one, Frame) and one.dtype == dtype]

    @cached_property
    def _all(self) -> list[Frame | ImuSamples | Triggers]:
        return list(self._load())


class Recording(np.ndarray[Any, np.dtype[np.void]]):
    """(n,) EVENT_DTYPE, in the order recorded, with the stream they belong to.

    It is an ordinary structured array (`recording["t"]`, slices, masks); `.stream`, `.frames`,
    `.imu` and `.triggers` go along with slices, masks and copies.
    """

    stream: StreamInfo
    _beside: Beside

    @classmethod
    def of(cls, events: Events, stream: StreamInfo, beside: Beside | None = None) -> Recording:
        """The events as a Recording, not copied."""
        recording = np.asarray(events, EVENT_DTYPE).view(cls)
        recording.stream = stream
        recording._beside = beside or Beside(tuple)
        return recording

    def __array_finalize__(self, parent: Any) -> None:
        for name in ("stream", "_beside"):
            value = getattr(parent, name, None)
            if value is not None:
                setattr(self, name, value)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All intensity frames of the recording, whatever events were selected; most have none."""
        return self._beside.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) all IMU samples of the recording: t, acceleration, angular_velocity, temperature."""
        return self._beside.imu

    @property
    def triggers(self) -> Triggers:
        """(n,) all triggers of the recording: t, kind (a Trigger)."""
        return self._beside.triggers

    @property
    def labels(self) -> Labels | None:
        """(n,) cause and geom_id of all its events, whatever was selected; None: it has none."""
        return self._beside.labels


def as_packet(seq: int, events: Events, stream: StreamInfo) -> EventPacket:
    """The packet of events, (n,) with n > 0, that were recorded together.

    Its interval is the ticks that they lie in: tick k is (t_{k-1}, t_k].
    """
    first, last, tick_us = int(events["t"][0]), int(events["t"][-1]), stream.tick_us
    # its ticks are counted from where it begins
    start_us = stream.start_us
    return EventPacket(
        seq=seq,
        time_base_us=start_us + (first - 1 - start_us) // tick_us * tick_us,
        time_end_us=start_us - (start_us - last) // tick_us * tick_us,
        width=stream.width,
        height=stream.height,
        events=events,
        camera=stream.camera,
    )


def one_stream(
    path: Path, streams: Sequence[StreamInfo], holds: Holds = ANYTHING, title: str = ""
) -> StreamInfo:
    """The only stream of a recorder; EvsError for another number of them, or too large a size.

    In: title, how people call the format that holds no more than this.
    """
    if len(streams) != 1:
        names = ", ".join(stream.camera for stream in streams) or "none"
        raise EvsError(
            f"{path} records exactly one camera, got {len(streams)} ({names}); "
            "give each camera a file of its own"
        )
    (stream,) = streams
    if 0 < stream.width <= holds.width and 0 < stream.height <= holds.height:
        return stream
    if title:
        fix = f"{title} holds at most {holds.width} x {holds.height} px, .aedat4 any size"
    else:
        fix = f"each side must be 1 ... {holds.width}"
    raise EvsError(f"cannot record {stream.width} x {stream.height} px to {path}; {fix}")


def check_stamps(path: Path, events: Events, holds: Holds, title: str, stream: StreamInfo) -> None:
    """EvsError unless these events, (n,) sorted, are of times that the format holds."""
    if not len(events):
        return
    first, last = int(events["t"][0]), int(events["t"][-1])
    lowest, highest = _ends(holds, stream)
    if first < lowest or last > highest:
        bad = first if first < lowest else last
        raise EvsError(
            f"cannot record an event at {bad} us to {path}; {title} holds {lowest} ... "
            f"{highest} us, .aedat4 any time"
        )


def fits(events: Events, holds: Holds, stream: StreamInfo) -> bool:
    """Whether a recording with these first events, (n,) with n > 0 and sorted, can begin."""
    first, last = int(events["t"][0]), int(events["t"][-1])
    lowest, highest = _ends(holds, stream)
    start = stream.start_us if holds.from_start else 0
    return lowest <= first and last <= highest and first - start < holds.silence_us


def _ends(holds: Holds, stream: StreamInfo) -> tuple[int, int]:
    """The lowest and the highest stamp that a format holds of a stream."""
    start = stream.start_us if holds.from_start else 0
    return holds.first_us + start, min(holds.last_us + start, holds.latest_us)


def target_error(path: Path, reason: OSError) -> EvsError:
    """One line for a file that cannot be written, with the fix."""
    folder = path.parent
    if isinstance(reason, FileNotFoundError | NotADirectoryError) and not folder.is_dir():
        return EvsError(f"cannot write {path}: there is no folder {folder}; mkdir -p {folder}")
    if isinstance(reason, IsADirectoryError):
        return EvsError(f"cannot write {path}: it is a folder; give a file name")
    return EvsError(f"cannot write {path}: {reason.strerror}; choose a place that you can write to")


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there; EvsError names its neighbours, nearest first."""
    found = Path(path)
    try:
        found.stat()
    except FileNotFoundError:
        pass
    except OSError as reason:
        raise EvsError(f"cannot read {found}: {reason.strerror}") from None
    if found.is_file():
        return found
    if found.is_dir():
        raise EvsError(f"{found} is a folder; give a file in it")
    if found.exists():
        raise EvsError(f"{found} is a pipe or a device: write what it gives to a file first")
    if not found.parent.is_dir():
        raise EvsError(f"no file {found}: there is no folder {found.parent}")
    known = {file.name for file in found.parent.iterdir() if file.suffix in SUFFIXES}
    shown = ", ".join(nearest_first(found.name, known)[:5])
    there = f"the folder has: {shown}" if shown else "the folder has no recordings"
    raise EvsError(f"no file {found}; {there}")
