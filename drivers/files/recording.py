"""Recording: the events of a file, with its stream and its auxiliary data."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

import numpy as np

from evs.msgs import (
    EVENT_DTYPE,
    IMU_DTYPE,
    TRIGGER_DTYPE,
    EventPacket,
    Events,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    Triggers,
    empty_imu,
    empty_triggers,
)


class AuxiliaryData:
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
    _auxiliary: AuxiliaryData

    @classmethod
    def of(
        cls, events: Events, stream: StreamInfo, auxiliary: AuxiliaryData | None = None
    ) -> Recording:
        """The events as a Recording, not copied."""
        recording = np.asarray(events, EVENT_DTYPE).view(cls)
        recording.stream = stream
        recording._auxiliary = auxiliary or AuxiliaryData(tuple)
        return recording

    def __array_finalize__(self, parent: Any) -> None:
        for name in ("stream", "_beside"):
            value = getattr(parent, name, None)
            if value is not None:
                setattr(self, name, value)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All intensity frames of the recording, whatever events were selected; most have none."""
        return self._auxiliary.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) all IMU samples of the recording: t, acceleration, angular_velocity, temperature."""
        return self._auxiliary.imu

    @property
    def triggers(self) -> Triggers:
        """(n,) all triggers of the recording: t, kind (a Trigger)."""
        return self._auxiliary.triggers

    @property
    def labels(self) -> Labels | None:
        """(n,) cause and geom_id of all its events, whatever was selected; None: it has none."""
        return self._auxiliary.labels


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
