"""Event Stream (.es), version 2, of DVS and ATIS events. Read only.

A header of 20 bytes: `Event Stream`, three bytes of version, the type of its events, and u16 width
and height. Then 5 bytes an event, u16 x and y (from the lower left) after a first byte:

    DVS   bits 1-7 time since the event before, us; bit 0 polarity
          0xff: no event, 127 us pass; 0xfe: nothing
    ATIS  bits 2-7 time, bit 1 polarity, bit 0: not a change event, but one of exposure
          0xfc | n: no event, 63 n us pass

Source: the description of the format, and what its own library does.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.header_text import read_file_head
from evs.drivers.files.integrity import IntegrityReport
from evs.drivers.files.recording_file import EventOnlyFile
from evs.drivers.files.time_order import in_order
from evs.msgs import Events, EvsError, StreamInfo, make_events
from evs.msgs.codecs.variable_length import code_starts

MAGIC, VERSION = b"Event Stream", 2
HEADER_BYTES, EVENT_BYTES = 20, 5
DVS, ATIS = 1, 2
_TYPES = {0: "generic", 3: "display", 4: "colour", 5: "liquid"}
_PIECE_BYTES = 1 << 17

Offsets = npt.NDArray[np.int64]


@dataclass
class EventStreamFile(EventOnlyFile):
    """An Event Stream file of a DVS or an ATIS, opened with `EventStreamFile.at(path)`."""

    kind: int = DVS
    """DVS or ATIS"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> EventStreamFile:
        """Open a file and read its header. EvsError: no such file, not of DVS or ATIS events."""
        found, head = read_file_head(path)
        if not head.startswith(MAGIC) or len(head) < HEADER_BYTES:
            raise EvsError(
                f"{found} is not a readable Event Stream file: its header must begin with "
                f"'{MAGIC.decode()}' and have {HEADER_BYTES} bytes"
            )
        version, kind = head[12], head[15]
        if version != VERSION:
            raise EvsError(f"{found} is of Event Stream version {version}; version 2 is read")
        if kind not in (DVS, ATIS):
            what = _TYPES.get(kind, f"type {kind}")
            raise EvsError(f"{found} holds no DVS or ATIS events but {what} ones")
        width, height = np.frombuffer(head, "<u2", 2, 16).tolist()
        if not (0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX):
            raise EvsError(f"{found} is damaged: it states a sensor of {width} x {height} px")
        return cls(
            found, StreamInfo(width, height, sensor="unknown"), found.stat().st_size, kind=kind
        )

    def events(self) -> Iterator[Events]:
        """The events of each ms that has any; an ATIS's exposures are counted in `left_out`."""
        integrity, left_out = IntegrityReport(noun="events"), dict[str, int]()
        yield from in_order(self._pieces(left_out), self.stream, integrity)
        integrity.torn_tail(self.position, self.size)
        self.integrity, self.left_out = integrity, left_out

    def _pieces(self, left_out: dict[str, int]) -> Iterator[tuple[Offsets, Events]]:
        """Byte offsets and events of each piece of the file, in the order recorded."""
        at, rest, now_us = HEADER_BYTES, b"", 0
        self.position = at
        with self.path.open("rb") as file:
            file.seek(at)
            while chunk := file.read(_PIECE_BYTES):
                codes = np.frombuffer(rest + chunk, np.uint8)
                alone = codes >= 0xFE if self.kind == DVS else codes >= 0xFC
                starts = code_starts(np.where(alone, 1, EVENT_BYTES))
                # the last event may go on in the next piece
                end = len(codes)
                if len(starts) and not alone[starts[-1]] and starts[-1] + EVENT_BYTES > end:
                    end = int(starts[-1])
                    starts = starts[:-1]
                first = codes[starts].astype(np.int64)
                times_us, is_event, exposures = self._parse(first)
                if exposures:
                    left_out["exposure events"] = left_out.get("exposure events", 0) + exposures
                stamps = now_us + np.cumsum(times_us)
                now_us = int(stamps[-1]) if len(stamps) else now_us
                where = starts[is_event]
                x, y = (
                    codes[where + k] | codes[where + k + 1].astype(np.int64) << 8 for k in (1, 3)
                )
                y = np.where(y < self.stream.height, self.stream.height - 1 - y, -1)
                on = first[is_event] >> (self.kind == ATIS) & 1
                yield at + where, make_events(stamps[is_event], x, y, on)
                rest = codes[end:].tobytes()
                at += end
                self.position = at

    def _parse(self, first: Offsets) -> tuple[Offsets, npt.NDArray[np.bool_], int]:
        """From the first byte of each code: the time that passes, us, whether it is an event.

        And how many of the others are an ATIS's events of exposure.
        """
        if self.kind == DVS:
            is_event = first < 0xFE
            return np.where(is_event, first >> 1, 127 * (first & 1)), is_event, 0
        timed = first < 0xFC
        exposures = timed & (first & 1 == 1)
        passed_us = np.where(timed, first >> 2, 63 * (first & 3))
        return passed_us, timed & ~exposures, int(np.count_nonzero(exposures))
