"""The base class of sinks: what a sink declares is what it writes."""

from __future__ import annotations

import pytest

from evs.drivers.bus import Publisher
from evs.drivers.dv import DvServer
from evs.drivers.files import formats
from evs.drivers.ros2 import Ros2Publisher
from evs.drivers.run.worker import WorkerSink
from evs.drivers.sink import Sink, Stream
from evs.drivers.viewer import ViewSink

METHODS = {
    Stream.EVENTS: ("write",),
    Stream.FRAMES: ("write_frame",),
    Stream.IMU: ("write_imu",),
    Stream.TRIGGERS: ("write_triggers",),
    Stream.POSE: ("wants_pose", "write_pose"),
    Stream.GROUND_TRUTH: ("wants_truth", "write_truth"),
    Stream.LIGHT: ("wants_light", "write_light"),
    Stream.PACE: ("write_pace",),
}


def sinks() -> list[type[Sink]]:
    """Every class of sink that can be used, abstract ones left out."""
    found, every = list[type[Sink]](), list[type[Sink]]([Sink])
    while every:
        below = every.pop().__subclasses__()
        every += below
        found += [one for one in below if one.__module__.startswith("evs.")]
    return [one for one in found if not one.__abstractmethods__]


def test_every_sink_declares_the_streams_whose_methods_it_has() -> None:
    known = {Publisher, DvServer, Ros2Publisher, ViewSink, WorkerSink}
    for one in formats.RECORDED:
        known.add(type(formats.by_name(one.name).record("a" + one.suffixes[0])))
    assert known <= set(sinks())
    for kind in sinks():
        # its streams are those of the sink that it runs elsewhere
        declared = set(Stream) if kind is WorkerSink else kind.streams
        for stream, names in METHODS.items():
            for name in names:
                has = getattr(kind, name) is not getattr(Sink, name)
                # a sink without a wants_... method wants every tick
                may_lack = name.startswith("wants_")
                assert has == (stream in declared) or (may_lack and not has), (kind, name)


def test_a_sink_of_few_lines_wants_every_tick_of_what_it_declares() -> None:
    class Counting(Sink):
        streams = frozenset({Stream.EVENTS, Stream.POSE})
        events = 0

        def open(self, streams: object) -> None:
            self.opened = streams

        def write(self, packet: object) -> None:
            self.events += packet is not None

        def close(self) -> dict[str, object]:
            return {"type": "counting", "events": self.events}

    sink = Counting()
    sink.prepare()
    sink.open([])
    assert not sink.stop_wanted
    assert sink.wants_pose("eye")
    assert sink.close() == {"type": "counting", "events": 0}
    with pytest.raises(TypeError, match="abstract"):
        Sink()  # type: ignore[abstract]
