"""DatRecorder: one camera's packets into a DAT file, 8 bytes an event."""

from __future__ import annotations

from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.header_text import stream_json
from evs.msgs import Events, EvsError, StreamInfo
from evs.msgs.codecs import encode_dat
from evs.msgs.codecs.dat import WRAP_US

STREAM, START = "evs_stream", "evs_start_us"
CHANGE_EVENTS, EVENT_BYTES = 0x0C, 8
"""The two bytes between the header's lines and the events."""


class DatRecorder(AppendingRecorder):
    """A Sink that writes DAT, version 2; the StreamInfo is a line of the header.

    The clock of a stream that begins too late for it counts from there; another line says so, and
    our reader adds it.
    """

    NAME = "dat"

    def _header(self, stream: StreamInfo) -> bytes:
        self._after_us = 0
        self._origin_us = stream.start_us if stream.start_us >= WRAP_US else 0
        lines = {
            "Version": "2",
            "Width": str(stream.width),
            "Height": str(stream.height),
            START: str(self._origin_us),
            STREAM: stream_json(stream),
        }
        text = "".join(f"% {key} {value}\n" for key, value in lines.items())
        return text.encode() + bytes([CHANGE_EVENTS, EVENT_BYTES])

    def _encode(self, events: Events) -> bytes:
        if self._origin_us:
            events = events.copy()
            events["t"] -= self._origin_us
        first_us = int(events["t"][0])
        if first_us < self._after_us:
            raise EvsError(
                f"{self._path}: events at {first_us} us come after {self._after_us} us, and DAT "
                "has no way back in time; record to .aedat4"
            )
        # a reader sees a wrap only where the stamp falls: never at the begin, or a wrap later
        stamps = events["t"]
        longest = max(first_us - self._after_us, int((stamps[1:] - stamps[:-1]).max(initial=0)))
        if longest >= WRAP_US:
            raise EvsError(
                f"cannot record nothing for {longest} us to {self._path}: DAT needs an event "
                "every 4294 s; record to .aedat4"
            )
        data = encode_dat(events, after_us=self._after_us)
        self._after_us = int(stamps[-1])
        return data
