"""Payloads of event_camera_msgs/EventPacket: the encodings, a writer and a reader."""

from __future__ import annotations

from typing import Any

from evs.msgs.codecs.codec import Codec, Payload
from evs.msgs.codecs.evt3 import Evt3
from evs.msgs.codecs.libcaer import Libcaer, LibcaerCompressed, Mono
from evs.msgs.codecs.limits import TIME_ORIGIN_US
from evs.msgs.errors import unknown
from evs.msgs.event import Events
from evs.msgs.trigger import Triggers

PAYLOADS: dict[str, type[Codec]] = {
    "evt3": Evt3,
    "libcaer": Libcaer,
    "libcaer_cmp": LibcaerCompressed,
    "mono": Mono,
}
"""name of an encoding, as event_camera_codecs has it -> what writes and reads it"""


def _codec(encoding: str, time_origin_us: int) -> Codec:
    if encoding not in PAYLOADS:
        raise unknown("encoding", encoding, PAYLOADS)
    return PAYLOADS[encoding](time_origin_us)


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
        self.encoding, self._codec = encoding, _codec(encoding, time_origin_us)

    def payload(self, events: Events, time_base_us: int | None = None) -> Payload:
        """Encode the next packet.

        Consecutive payloads may be joined under the time base of the first one. For mono and
        libcaer_cmp, pass that time base as `time_base_us` of the following payloads. Payloads of
        libcaer can span up to 2147 s.

        Args:
            events: (n,) EVENT_DTYPE, sorted by t, none before the last packet's.
            time_base_us: Time base of mono and libcaer_cmp, us; None: the first event's time. The
                time base of evt3 is 0, as with real drivers: its words hold the time.

        Raises:
            MessageError: The events do not fit into the encoding.
        """
        return self._codec.encode(events, time_base_us)


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
        self.encoding, self._codec = encoding, _codec(encoding, time_origin_us)

    @property
    def skipped(self) -> int:
        """Events so far that came before the first time stamp."""
        return self._codec.skipped

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
        return self._codec.decode(data, time_base_ns, triggers)
