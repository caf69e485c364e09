"""Recorders of RAW files of EVT2, EVT2.1 or EVT3, as Prophesee's cameras write them."""

from __future__ import annotations

from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.raw.header import header_bytes
from evs.msgs import Events, EvsError, StreamInfo
from evs.msgs.codecs import TIME_ORIGIN_US, encode_evt2, encode_evt3, encode_evt21


class _RawRecorder(AppendingRecorder):
    """A RAW file's clock is at TIME_ORIGIN_US when the stream begins, as a camera's own would be.

    Its header says so, and our reader takes it off.

    Every packet restates the time, so a file that was cut anywhere is read up to there.
    """

    _VERSION: str

    def _header(self, stream: StreamInfo) -> bytes:
        self._origin_us = TIME_ORIGIN_US - stream.start_us
        self._after_us = -self._origin_us
        return header_bytes(stream, self._VERSION, self._origin_us)

    def _encode(self, events: Events) -> bytes:
        if int(events["t"][0]) < self._after_us:
            raise EvsError(
                f"{self._path}: events at {events['t'][0]} us come after {self._after_us} us, and "
                f"{self._format_name} has no way back in time; record to .aedat4"
            )
        data = self._words(events)
        self._after_us = int(events["t"][-1])
        return data

    def _words(self, events: Events) -> bytes:
        raise NotImplementedError


class Evt3Recorder(_RawRecorder):
    """EVT3: 2 to 8 bytes an event."""

    NAME, _VERSION = "evt3", "3.0"

    def _words(self, events: Events) -> bytes:
        return encode_evt3(events, time_origin_us=self._origin_us, after_us=self._after_us)


class Evt2Recorder(_RawRecorder):
    """EVT2: 4 bytes an event, and 4 for each new 64 us."""

    NAME, _VERSION = "evt2", "2.0"

    def _words(self, events: Events) -> bytes:
        return encode_evt2(events, time_origin_us=self._origin_us, after_us=self._after_us)


class Evt21Recorder(_RawRecorder):
    """EVT2.1: 8 bytes for up to 32 events of one instant and row, and 8 for each new 64 us."""

    NAME, _VERSION = "evt21", "2.1"

    def _words(self, events: Events) -> bytes:
        return encode_evt21(events, time_origin_us=self._origin_us, after_us=self._after_us)
