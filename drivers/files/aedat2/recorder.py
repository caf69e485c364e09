"""Aedat2Recorder: events as a DAVIS's, in files of 2^31 us.

Stamps wrap at 2^31 us (35.8 min), and nothing tells how often. So the recorder splits: run.aedat,
run-001.aedat, ...; each says its `time_base_us`, so that each is read with its true times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from evs.drivers.files.aedat2.layout import END, EVS_LINE, SPAN_US, WORD
from evs.drivers.files.aedat2.reader import Aedat2File
from evs.drivers.files.appending_recorder import AppendingRecorder
from evs.drivers.files.formats import AnyPath
from evs.drivers.files.header_text import stream_json
from evs.drivers.files.multi_file import check_no_parts, check_not_continued, part_path
from evs.msgs import EventPacket, Events, EvsError, StreamInfo

_AER_CHIPS = {(346, 260): "Davis346blue", (240, 180): "DAVIS240C"}


class Aedat2Recorder(AppendingRecorder):
    """A Sink that writes AEDAT2 as a DAVIS would, one file for each 2^31 us of the stream."""

    NAME = "aedat2"

    def __init__(self, path: AnyPath) -> None:
        super().__init__(path)
        self._base_us = 0
        self._parts = 1
        self._written = 0

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """As AppendingRecorder's. EvsError also if an earlier recording would continue it."""
        check_not_continued(self._path, Aedat2File.at)
        super().open(streams)

    def write(self, packet: EventPacket) -> None:
        """Append one packet, to as many files as it needs. Errors as AppendingRecorder's."""
        begin, stamps = 0, packet.events["t"]
        while begin < len(stamps):
            base_us = int(stamps[begin]) // SPAN_US * SPAN_US
            end = int(np.searchsorted(stamps, base_us + SPAN_US))
            if base_us != self._base_us and not self._failure and base_us >= 0:
                self._next(base_us)
            super().write(replace(packet, events=packet.events[begin:end]))
            begin = end

    def close(self) -> dict[str, Any]:
        """As AppendingRecorder's, with the number of files."""
        report = super().close()
        return report | {"bytes": self._written + self._position, "files": self._parts}

    def _next(self, base_us: int) -> None:
        """Continue in another file, or restart this one if it is empty."""
        if self._file is None:
            return
        if base_us < self._base_us:
            raise EvsError(
                f"cannot record to {self._path}: time steps back from {self._base_us} us to "
                f"{base_us} us or a little later, and AEDAT2 cannot say so; write .aedat4"
            )
        path = self._path if not self._events else part_path(self._path, self._parts)
        self._finish_file()
        if self._events:
            if self._parts == 1:
                check_no_parts(self._path)
            self._parts += 1
            self._written += self._position
        self._base_us = base_us
        self._start_file(path)

    def _header(self, stream: StreamInfo) -> bytes:
        chip = _AER_CHIPS.get((stream.width, stream.height))
        lines = [
            "#!AER-DAT2.0",
            "# This is a raw AE data file, by evs - do not edit",
            "# Data format is int32 address, int32 timestamp (8 bytes total), repeated",
            "# Timestamps tick is 1 us",
            *([f"# AEChip: eu.seebetter.ini.chips.davis.{chip}"] if chip else []),
            EVS_LINE + stream_json(stream, time_base_us=self._base_us, part=self._parts),
            END,
        ]
        return "".join(f"{line}\r\n" for line in lines).encode()

    def _encode(self, events: Events) -> bytes:
        words = np.empty(len(events), WORD)
        x = self.stream.width - 1 - events["x"].astype(np.uint32)
        y = self.stream.height - 1 - events["y"].astype(np.uint32)
        words["address"] = y << 22 | x << 12 | (events["p"] != 0).astype(np.uint32) << 11
        words["stamp"] = events["t"] - self._base_us
        return words.tobytes()
