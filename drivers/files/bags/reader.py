"""BagFile: the events of a ROS bag, ours or a real camera driver's."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.bags.library import ARRAY, PACKET, TEXT, load, typestore
from evs.drivers.files.bags.messages import ArrayMessage, BadMessageError, parse_array
from evs.drivers.files.bags.recorder import STREAM_TOPIC
from evs.drivers.files.damage import Damage
from evs.drivers.files.parts import in_order, on_sensor
from evs.drivers.files.recorded import EventsFile, said_stream
from evs.drivers.files.recording import existing
from evs.msgs import Events, EvsError, StreamInfo
from evs.msgs.encodings import PAYLOADS, PayloadReader
from evs.msgs.fields import MAX_PIXELS

ARRAYS = (ARRAY, "prophesee_event_msgs/msg/EventArray")
PACKETS = (PACKET, "event_array_msgs/msg/EventArray")
"""Message types of one layout: what they are called now, and what other or older drivers said."""


@dataclass
class BagFile(EventsFile):
    """One bag, opened with `BagFile.at(path)`; packets come back as they were packed."""

    ros: int = 2
    topic: str = ""
    """whose events these are"""
    others: int = 0
    """messages of other cameras' events"""
    time_origin_us: int = 0

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> BagFile:
        """Read the index and the first packet.

        EvsError: no such file, rosbags is not installed, damaged, no events of a type that we know.
        """
        found = existing(path)
        load()
        ros = 1 if found.suffix.lower() == ".bag" else 2
        opened = cls(found, StreamInfo(0, 0), found.stat().st_size, ros=ros)
        try:
            opened._look()
        except EvsError:
            raise
        except Exception as reason:  # damaged bytes make rosbags raise a dozen kinds
            raise EvsError(f"cannot read {found}: {_said(reason)}") from None
        return opened

    def events(self) -> Iterator[Events]:
        """The events of each message that has any, those of one message sorted."""
        damage, skipped, number = Damage(), 0, 0
        readers: dict[str, PayloadReader] = {}
        left_out: dict[str, int] = {}
        try:
            for number, message in enumerate(self._messages()):
                try:
                    events = self._taken(message, readers, left_out)
                except (BadMessageError, EvsError) as reason:
                    damage.lost(f"in message {number}", str(reason))
                    continue
                events, outside = on_sensor(events, self.stream.width, self.stream.height)
                if outside:
                    damage.lost(f"in message {number}", f"{outside} events lie outside the sensor")
                if len(events):
                    yield in_order(events)
        except Exception as reason:  # as above
            damage.lost(f"after message {number}", _said(reason))
        skipped = sum(reader.skipped for reader in readers.values())
        if skipped:
            left_out["events before the first time stamp"] = skipped
        if self.others:
            left_out["messages with events of other topics"] = self.others
        self.damage, self.left_out = damage, left_out

    def _look(self) -> None:
        """Choose the topic, and find out what its stream is."""
        with _reader(self.path, self.ros) as bag:
            known = [one for one in bag.connections if one.msgtype in (*ARRAYS, *PACKETS)]
            if not known:
                kinds = ", ".join(sorted({one.msgtype for one in bag.connections})) or "nothing"
                raise EvsError(f"{self.path} holds no events but {kinds[:200]}")
            chosen = max(known, key=lambda one: (one.msgcount, one.topic))
            self.topic = chosen.topic
            self.others = sum(one.msgcount for one in known if one.topic != chosen.topic)
            said = self._said_stream(bag)
        first: Any = next(self._messages(), None)
        width, height = (1, 1) if first is None else (first.width, first.height)
        if not 0 < min(width, height) <= max(width, height) <= MAX_PIXELS:
            raise EvsError(f"{self.path} is damaged: its sensor is of {width} x {height} px")
        plain = StreamInfo(int(width), int(height), sensor="unknown")
        name = getattr(first, "frame_id", "") or ""
        if name.isprintable() and 0 < len(name.encode()) < 256:
            plain = dataclasses.replace(plain, camera=name)
        stream = said_stream(said.get("stream"), plain)
        self.stream = dataclasses.replace(stream, frames=False, imu=False)
        origin = said.get("time_origin_us", 0)
        self.time_origin_us = origin if isinstance(origin, int) and 0 <= origin < 1 << 50 else 0

    def _said_stream(self, bag: Any) -> dict[str, Any]:
        """What our recorder says of its stream; nothing in others' bags."""
        topic = self.topic.rpartition("/")[0] + "/" + STREAM_TOPIC
        ours = [one for one in bag.connections if one.topic == topic and one.msgtype == TEXT]
        store = typestore(self.ros)
        with suppress(Exception):
            for _, _, data in bag.messages(connections=ours) if ours else ():
                said = json.loads(self._deserialised(store, data, TEXT).data)
                return said if isinstance(said, dict) else {}
        return {}

    def _messages(self) -> Iterator[Any]:
        """Its messages with events, parsed: an EventPacket or an ArrayMessage."""
        store = typestore(self.ros)
        with _reader(self.path, self.ros) as bag:
            chosen = [one for one in bag.connections if one.topic == self.topic]
            for topic, _, data in bag.messages(connections=chosen):
                if topic.msgtype in ARRAYS:
                    yield parse_array(bytes(data), self.ros)
                elif topic.msgtype in PACKETS:
                    message = self._deserialised(store, data, PACKET)
                    message.frame_id = message.header.frame_id
                    yield message

    def _deserialised(self, store: Any, data: bytes, kind: str) -> Any:
        take = store.deserialize_ros1 if self.ros == 1 else store.deserialize_cdr
        return take(data, kind)

    def _taken(
        self, message: Any, readers: dict[str, PayloadReader], left_out: dict[str, int]
    ) -> Events:
        if isinstance(message, ArrayMessage):
            return message.events
        name = message.encoding
        if name not in PAYLOADS:
            what = f"packets of encoding {name[:20]!r}"
            left_out[what] = left_out.get(what, 0) + 1
            return PayloadReader("mono").events(b"", 0)
        if name not in readers:
            readers[name] = PayloadReader(name, time_origin_us=self.time_origin_us)
        return readers[name].events(np.ascontiguousarray(message.events), int(message.time_base))


def _reader(path: Path, ros: int) -> Any:
    """The library's reader of a bag."""
    bags = load()
    return bags.rosbag1.Reader(path) if ros == 1 else bags.rosbag2.Reader(path)


def _said(reason: Exception) -> str:
    """A library's error as one line."""
    return (str(reason) or type(reason).__name__).splitlines()[0][:300]
