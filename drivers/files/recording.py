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
    """The frames, IMU samples and triggers of a recording, read when first used."""

    def __init__(
        self,
        load: Callable[[], Iterable[Frame | ImuSamples | Triggers]],
        labels: Labels | None = None,
    ) -> None:
        """Keep how to read them.

        Args:
            load: Reads all frames, IMU samples and triggers.
            labels: (n,) labels of all events; None: the recording has none.
        """
        self._load, self.labels = load, labels

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """All frames, in the order recorded."""
        return tuple(one for one in self._all if isinstance(one, Frame))

    @cached_property
    def imu(self) -> ImuSamples:
        """(n,) IMU_DTYPE, all samples."""
        return np.concatenate([empty_imu(), *self._of(IMU_DTYPE)])

    @cached_property
    def triggers(self) -> Triggers:
        """(n,) TRIGGER_DTYPE, all triggers."""
        return np.concatenate([empty_triggers(), *self._of(TRIGGER_DTYPE)])

    def _of(self, dtype: np.dtype[Any]) -> list[ImuSamples | Triggers]:
        return [one for one in self._all if not isinstance(one, Frame) and one.dtype == dtype]

    @cached_property
    def _all(self) -> list[Frame | ImuSamples | Triggers]:
        return list(self._load())


class Recording(np.ndarray[Any, np.dtype[np.void]]):
    """The events of a recording, (n,) EVENT_DTYPE in the order recorded, with their stream.

    It is an ordinary structured array (`recording["t"]`, slices, masks). Slices, masks and copies
    keep `.stream`, `.frames`, `.imu` and `.triggers`.
    """

    stream: StreamInfo
    _auxiliary: AuxiliaryData

    @classmethod
    def of(
        cls, events: Events, stream: StreamInfo, auxiliary: AuxiliaryData | None = None
    ) -> Recording:
        """A Recording that shares the memory of the events, (n,) EVENT_DTYPE."""
        recording = np.asarray(events, EVENT_DTYPE).view(cls)
        recording.stream = stream
        recording._auxiliary = auxiliary or AuxiliaryData(tuple)
        return recording

    def __array_finalize__(self, parent: Any) -> None:
        for name in ("stream", "_auxiliary"):
            value = getattr(parent, name, None)
            if value is not None:
                setattr(self, name, value)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All intensity frames of the recording, whichever events are selected."""
        return self._auxiliary.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) IMU_DTYPE, all samples: t, acceleration, angular_velocity, temperature."""
        return self._auxiliary.imu

    @property
    def triggers(self) -> Triggers:
        """(n,) TRIGGER_DTYPE, all triggers: t, kind (a Trigger)."""
        return self._auxiliary.triggers

    @property
    def labels(self) -> Labels | None:
        """(n,) LABEL_DTYPE, cause and geom_id of all its events; None: it has none."""
        return self._auxiliary.labels


def as_packet(seq: int, events: Events, stream: StreamInfo) -> EventPacket:
    """Make a packet of events that were recorded together.

    Args:
        seq: Number of the packet.
        events: (n,) EVENT_DTYPE with n > 0, sorted by t.
        stream: Their stream.

    Returns:
        The packet. Its interval is made of the ticks that the events lie in: tick k is
        (t_{k-1}, t_k].
    """
    first, last, tick_us = int(events["t"][0]), int(events["t"][-1]), stream.tick_us
    # ticks are counted from the start of the stream
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
