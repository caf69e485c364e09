"""Player: a recording, or a part of it, into any sinks, each message at its time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers import files
from evs.drivers.clock import Pacer
from evs.drivers.files.formats import ReadOptions
from evs.drivers.run.sink_set import SinkSet
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket, TriggerPacket, make_events

Message = EventPacket | Frame | ImuPacket | TriggerPacket
Rows = np.ndarray[Any, np.dtype[np.void]]


class Player:
    """Plays one recording. `played` counts what it has given to the sinks."""

    def __init__(
        self,
        file: str | Path,
        sinks: SinkSet,
        pacer: Pacer,
        *,
        start_us: int | None = None,
        stop_us: int | None = None,
        rounds: int = 1,
        reading: ReadOptions | None = None,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            file: The recording.
            sinks: Where it goes, not open yet.
            pacer: What each message waits for.
            start_us: Messages up to here are left out, us from the first event (`files.origin_us`);
                None: from the first.
            stop_us: Messages after this are left out, likewise; None: to the last.
            rounds: How often it is played; 0: until it is stopped. Time goes on: each round
                begins where the one before ended.
            reading: How the recording is read: options of `files.read`.

        Raises:
            EvsError: The part is empty, or the number of rounds is negative.
        """
        if rounds < 0:
            raise EvsError(f"{rounds} rounds are not possible: give 1 or more, or 0 for no end")
        self._start_us = -math.inf if start_us is None else start_us
        self._stop_us = math.inf if stop_us is None else stop_us
        self._is_part = start_us is not None or stop_us is not None
        if not self._start_us < self._stop_us:
            raise EvsError(
                f"nothing lies between {self._start_us} us and {self._stop_us} us: give a later "
                "stop, or an earlier start"
            )
        self._file, self._reading, self._rounds = file, reading or {}, rounds
        self._sinks, self._pacer = sinks, pacer
        self.played: Counter[str] = Counter()
        """packets, events, frames, imu (samples), triggers, rounds (whole ones)"""
        self._next_seq = {kind: count() for kind in (EventPacket, Frame, ImuPacket, TriggerPacket)}

    def play(self, stopped: Sequence[object], begun: Callable[[], None] = lambda: None) -> None:
        """Open the sinks and play to the end, or until `stopped` is not empty.

        The sinks are to be closed by the caller, however this ends.

        Args:
            stopped: Filled by somebody else, as by a signal handler.
            begun: Called once the sinks are open.

        Raises:
            EvsError: The recording cannot be read, has nothing in the part, or a sink failed.
        """
        opened = files.opened(self._file, **self._reading)
        stream = opened.stream
        if self._is_part:
            # once: play may be called again
            origin_us, self._is_part = files.origin_us(opened), False
            self._start_us, self._stop_us = self._start_us + origin_us, self._stop_us + origin_us
        self._sinks.open([stream])
        begun()
        later_us = 0
        while not self._rounds or self.played["rounds"] < self._rounds:
            begin_us, end_us = None, 0
            for message in self._part():
                if isinstance(message, Frame):
                    message = message.on_sensor(stream.width, stream.height)
                if stopped or self._sinks.stop_wanted:
                    return
                first_us, last_us = _interval(message)
                begin_us = first_us if begin_us is None else min(begin_us, first_us)
                end_us = max(end_us, last_us)
                self._pacer.wait_until(last_us + later_us)
                if stopped:
                    return
                self._sinks.write_recorded(self._at(message, later_us), stream)
                self._count(message)
            if begin_us is None:
                raise EvsError(
                    f"{self._file} has nothing in this part: --start and --stop count from its "
                    "first event, and `evs info` gives its length"
                )
            later_us += end_us - begin_us
            self.played["rounds"] += 1

    def _part(self) -> Iterator[Message]:
        """The messages of the part; packets at its ends lose the events outside."""
        for message in files.messages(self._file, **self._reading):
            first_us, last_us = _interval(message)
            if isinstance(message, EventPacket):
                if last_us <= self._start_us or first_us >= self._stop_us:
                    continue
                yield self._cut(message)
            elif isinstance(message, Frame):
                if self._start_us < last_us <= self._stop_us:
                    yield message
            elif isinstance(message, ImuPacket):
                if len(samples := self._inside(message.samples)):
                    yield replace(message, samples=samples)
            elif len(triggers := self._inside(message.triggers)):
                yield replace(message, triggers=triggers)

    def _inside(self, rows: Rows) -> Rows:
        """The IMU samples or triggers of the part."""
        return rows[(rows["t"] > self._start_us) & (rows["t"] <= self._stop_us)]

    def _cut(self, packet: EventPacket) -> EventPacket:
        begin_us = int(max(packet.time_base_us, self._start_us))
        end_us = int(min(packet.time_end_us, self._stop_us))
        if (begin_us, end_us) == (packet.time_base_us, packet.time_end_us):
            return packet
        first, last = np.searchsorted(packet.events["t"], (begin_us, end_us), side="right")
        events = packet.events[first:last]
        return replace(packet, time_base_us=begin_us, time_end_us=end_us, events=events)

    def _at(self, message: Message, later_us: int) -> Message:
        """The message with the next number of its kind, so much later."""
        seq = next(self._next_seq[type(message)])
        if isinstance(message, Frame):
            names = ("begin_us", "exposure_begin_us", "exposure_end_us", "end_us")
            times = {name: getattr(message, name) + later_us for name in names}
            return replace(message, seq=seq, **times)
        if isinstance(message, ImuPacket):
            samples = message.samples.copy()
            samples["t"] += later_us
            return replace(message, seq=seq, samples=samples)
        if isinstance(message, TriggerPacket):
            triggers = message.triggers.copy()
            triggers["t"] += later_us
            return replace(message, seq=seq, triggers=triggers)
        if not later_us:
            return replace(message, seq=seq)
        stamps, x, y, p = (message.events[name] for name in "txyp")
        return replace(
            message,
            seq=seq,
            time_base_us=message.time_base_us + later_us,
            time_end_us=message.time_end_us + later_us,
            events=make_events(stamps + later_us, x, y, p),
        )

    def _count(self, message: Message) -> None:
        if isinstance(message, EventPacket):
            self.played["packets"] += 1
            self.played["events"] += len(message)
        elif isinstance(message, Frame):
            self.played["frames"] += 1
        else:
            self.played["imu" if isinstance(message, ImuPacket) else "triggers"] += len(message)


def _interval(message: Message) -> tuple[int, int]:
    """When a message begins and ends, us."""
    if isinstance(message, EventPacket):
        return message.time_base_us, message.time_end_us
    if isinstance(message, Frame):
        return message.begin_us, message.end_us
    stamps = (message.samples if isinstance(message, ImuPacket) else message.triggers)["t"]
    return int(stamps[0]), int(stamps[-1])
