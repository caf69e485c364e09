"""The sinks of a run: one that stops is left out, and the camera and the others go on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from evs.drivers.run.sink_set import SinkSet
from evs.drivers.sink import Sink, SinkStoppedError, Stream
from evs.emulator.base.protocols import NoMeter
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, StreamInfo, Trigger, TriggerPacket

INFO = StreamInfo(4, 3, camera="eye", frames=True, imu=True, triggers=True)
FULL = "recording to run.aedat4 stopped after 7 events: no space"


class Keeper(Sink):
    """Takes everything until it has had `room` messages."""

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.TRIGGERS})

    def __init__(self, room: int = 1000) -> None:
        self.room, self.taken, self.closed = room, list[Any](), 0

    def open(self, streams: Sequence[StreamInfo]) -> None:
        assert list(streams) == [INFO]

    def take(self, message: object) -> None:
        if len(self.taken) == self.room:
            raise SinkStoppedError(FULL)
        self.taken.append(message)

    write = write_frame = write_imu = write_triggers = take

    def close(self) -> dict[str, Any]:
        self.closed += 1
        return {"type": "keeper", "taken": len(self.taken)}


class Camera:
    info = INFO

    def __init__(self, frames: Sequence[Frame] = (), imu_packet: ImuPacket | None = None) -> None:
        self.frames, self.imu_packet = frames, imu_packet


def packet(seq: int) -> EventPacket:
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 4, 3, camera="eye")


def frame(seq: int) -> Frame:
    return Frame(seq, 10, 20, 30, 40, np.zeros((3, 4), np.uint8), "eye")


def opened(*sinks: Keeper) -> tuple[SinkSet, list[str]]:
    warnings: list[str] = []
    made = SinkSet(sinks, NoMeter(), warnings.append)
    made.open([INFO])
    return made, warnings


def test_a_sink_that_stops_is_told_once_and_the_others_get_everything() -> None:
    full, good = Keeper(room=2), Keeper()
    made, warnings = opened(full, good)
    for seq in range(5):
        made.write([packet(seq)])
    assert warnings == [FULL]
    assert [one.seq for one in full.taken] == [0, 1]
    assert [one.seq for one in good.taken] == [0, 1, 2, 3, 4]
    assert made.close() is None
    assert (full.closed, good.closed) == (1, 1)
    assert [said["taken"] for said in made.reports] == [2, 5]


def test_a_sink_that_stops_in_the_midst_of_a_tick_gets_nothing_more_of_it() -> None:
    full, good = Keeper(room=1), Keeper()
    made, warnings = opened(full, good)
    made.write_auxiliary([Camera([frame(0), frame(1)], ImuPacket(0, camera="eye"))], 1000)
    made.write([packet(0)])
    assert len(full.taken) == 1
    assert len(good.taken) == 6
    assert warnings == [FULL]


def test_the_last_sink_that_stops_ends_the_run() -> None:
    made, warnings = opened(Keeper(room=0), Keeper(room=1))
    made.write([packet(0)])
    with pytest.raises(SinkStoppedError, match="no space"):
        made.write([packet(1)])
    assert warnings == [FULL]


def test_another_error_of_a_sink_is_no_end_of_it() -> None:
    class Refusing(Keeper):
        def write(self, message: object) -> None:
            raise EvsError("this camera is unknown")

    made, warnings = opened(Keeper())
    refusing, _ = opened(Refusing(), Keeper())
    with pytest.raises(EvsError, match="unknown"):
        refusing.write([packet(0)])
    assert warnings == []
    assert made.close() is None


def test_each_frame_brings_its_four_triggers() -> None:
    keeper = Keeper()
    made, _ = opened(keeper)
    made.write_auxiliary([Camera([frame(0)])], 1000)
    made.write_auxiliary([Camera([frame(1)])], 2000)
    triggers = [one for one in keeper.taken if isinstance(one, TriggerPacket)]
    assert [(one.seq, one.camera) for one in triggers] == [(0, "eye"), (1, "eye")]
    assert triggers[0].triggers.tolist() == [
        (10, Trigger.APS_FRAME_START),
        (20, Trigger.APS_EXPOSURE_START),
        (30, Trigger.APS_EXPOSURE_END),
        (40, Trigger.APS_FRAME_END),
    ]
    # after the frame that they belong to
    assert [type(one) for one in keeper.taken] == [Frame, TriggerPacket] * 2
