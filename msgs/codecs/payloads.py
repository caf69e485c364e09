"""Payloads of event_camera_msgs/EventPacket: writer and reader for each encoding."""

from __future__ import annotations

from typing import Any

from evs.msgs.codecs.evt3 import EVT3, Evt3State, decode_evt3, encode_evt3
from evs.msgs.codecs.libcaer import (
    LIBCAER,
    LIBCAER_CMP,
    MONO,
    Payload,
    decode_libcaer,
    decode_libcaer_cmp,
    decode_mono,
    encode_libcaer,
    encode_libcaer_cmp,
    encode_mono,
)
from evs.msgs.codecs.limits import TIME_ORIGIN_US, EncodingLimits
from evs.msgs.errors import unknown
from evs.msgs.event import Events
from evs.msgs.trigger import Triggers

PAYLOADS: dict[str, EncodingLimits] = {
    "evt3": EVT3,
    "libcaer": LIBCAER,
    "libcaer_cmp": LIBCAER_CMP,
    "mono": MONO,
}
"""name of an encoding -> what it can hold"""


class PayloadWriter:
    """Encodes the payloads of one camera's packets, one after the other."""

    def __init__(self, encoding: str, *, time_origin_us: int = TIME_ORIGIN_US) -> None:
        """Start a stream.

        Args:
            encoding: A key of PAYLOADS.
            time_origin_us: Time stamp of time zero, us, for evt3.

        Raises:
            EvsError: The encoding is unknown.
        """
        if encoding not in PAYLOADS:
            raise unknown("encoding", encoding, PAYLOADS)
        self.encoding, self.time_origin_us = encoding, time_origin_us
        self._after_us = -time_origin_us

    def payload(self, events: Events, time_base_us: int | None = None) -> Payload:
        """Encode the next packet.

        Consecutive payloads may be joined under the first one's time base: those of mono and
        libcaer_cmp if it is time_base_us of those that follow, those of libcaer up to 2147 s.

        Args:
            events: (n,) EVENT_DTYPE, sorted by t, none before the last packet's.
            time_base_us: Time base of mono and libcaer_cmp, us; None: the first event's time. The
                time base of evt3 is 0, as with real drivers: its words hold the time.

        Raises:
            MessageError: The events do not fit into the encoding.
        """
        if self.encoding == "mono":
            return encode_mono(events, time_base_us)
        if self.encoding == "libcaer":
            return encode_libcaer(events)
        if self.encoding == "libcaer_cmp":
            return encode_libcaer_cmp(events, time_base_us)
        data = encode_evt3(events, time_origin_us=self.time_origin_us, after_us=self._after_us)
        if len(events):
            self._after_us = int(events["t"][-1])
        return Payload(0, data)


class PayloadReader:
    """Decodes the payloads of one camera's packets, one after the other."""

    def __init__(self, encoding: str, *, time_origin_us: int = TIME_ORIGIN_US) -> None:
        """Start a stream.

        Args:
            encoding: A key of PAYLOADS.
            time_origin_us: Time stamp of time zero, us, for evt3.

        Raises:
            EvsError: The encoding is unknown.
        """
        if encoding not in PAYLOADS:
            raise unknown("encoding", encoding, PAYLOADS)
        self.encoding, self.time_origin_us = encoding, time_origin_us
        self._state = Evt3State()

    @property
    def skipped(self) -> int:
        """Events so far that came before the first time stamp."""
        return self._state.skipped

    def events(
        self, data: Any, time_base_ns: int, triggers: list[Triggers] | None = None
    ) -> Events:
        """Decode the next packet. Never raises.

        Args:
            data: Any contiguous buffer with the payload.
            time_base_ns: Time base of the packet, ns.
            triggers: A list that takes the packet's external triggers; only evt3 has them.

        Returns:
            (n,) events in the order sent, which may be unsorted.
        """
        if self.encoding == "mono":
            return decode_mono(data, time_base_ns)
        if self.encoding == "libcaer":
            return decode_libcaer(data, time_base_ns)
        if self.encoding == "libcaer_cmp":
            return decode_libcaer_cmp(data, time_base_ns)
        origin = self.time_origin_us
        events, self._state = decode_evt3(
            data, self._state, time_origin_us=origin, triggers=triggers
        )
        return events
