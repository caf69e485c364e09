"""DatFile: a DAT file as a stream of events."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from evs.drivers.files.damage import Damage, on_sensor
from evs.drivers.files.dat.library import is_fault, load
from evs.drivers.files.ordered import InOrder
from evs.drivers.files.raw.header import MAX_HEADER_BYTES
from evs.drivers.files.recorded import EventsFile
from evs.drivers.files.recording import existing
from evs.msgs import Events, EvsError, StreamInfo, make_events

_EVENT_BYTES = 8
_FALLBACK = (1280, 720)
"""Size of the sensor where the header says none."""


@dataclass
class DatFile(EventsFile):
    """One DAT file, opened with `DatFile.at(path)`; faery decodes it."""

    begin: int = 0
    """where its events begin, bytes"""

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> DatFile:
        """Read the header. EvsError: no such file, no faery, no DAT file of events."""
        found = existing(path)
        faery = load()
        try:
            size = found.stat().st_size
            with found.open("rb") as file:
                begin = _header_bytes(file.read(MAX_HEADER_BYTES))
            with faery.dat.Decoder(found, _FALLBACK, "dat2") as decoder:
                kind, sides = decoder.event_type, decoder.dimensions
        except OSError as reason:
            raise EvsError(f"cannot read {found}: {reason.strerror}") from None
        except BaseException as reason:
            if not is_fault(reason):
                raise
            said = " ".join(str(reason).split())
            raise EvsError(f"{found} is not a readable DAT file: {said}") from None
        if kind != "cd" or sides is None:
            raise EvsError(f"{found} holds no change events but {kind!r}")
        stream = StreamInfo(sides[0], sides[1], sensor="unknown")
        return cls(found, stream, size, begin=begin)

    def events(self) -> Iterator[Events]:
        """The events of each ms that has any."""
        damage = Damage(what="events")
        order = InOrder(damage, self.stream.tick_us)
        for at, piece in self._pieces(damage):
            yield from order.feed(piece, np.broadcast_to(np.int64(at), len(piece)))
        yield from order.rest()
        self.damage = damage

    def _pieces(self, damage: Damage) -> Iterator[tuple[int, Events]]:
        """Where each piece of the file begins, and its events."""
        read = 0
        width, height = self.stream.width, self.stream.height
        with load().dat.Decoder(self.path, _FALLBACK, "dat2") as decoder:
            while True:
                at = self.begin + read * _EVENT_BYTES
                try:
                    rows = next(decoder, None)
                except BaseException as reason:
                    if not is_fault(reason):
                        raise
                    damage.packet(at, str(reason))
                    break
                if rows is None:
                    break
                read += len(rows)
                t = rows["t"].astype(np.int64)
                piece = make_events(t, rows["x"], rows["y"], rows["payload"] > 0)
                piece, outside = on_sensor(piece, width, height)
                if outside:
                    damage.packet(at, f"outside of {width} x {height} px", outside)
                self.position = at
                yield at, piece
        damage.tail(self.begin + read * _EVENT_BYTES, self.size)


def _header_bytes(head: bytes) -> int:
    """Where the events begin: behind the lines of text, and two bytes that say what events are."""
    at = 0
    while head.startswith(b"%", at):
        end = head.find(b"\n", at)
        if end < 0:
            break
        at = end + 1
    return at + 2
