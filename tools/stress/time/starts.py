"""Streams that begin at 2^31 us, at a Unix time, in the year 2112: files, bus, player."""

from __future__ import annotations

import threading
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evs.drivers.bus import Publisher, subscribe
from evs.drivers.files import formats, messages, stream_of
from evs.emulator import World
from evs.emulator.base.stamps import MAX_START_US
from evs.msgs import EventPacket, Events, join_events
from evs.tools.stress.capture import capture
from evs.tools.stress.grid_target import FLASH_PX, HEIGHT_PX, grid_mjcf, place
from evs.tools.stress.light.levels import USUAL
from evs.tools.stress.stress_case import Measurement, StressCase

UNIX_US = 1_795_305_600_000_000
"""22 November 2026 as a Unix time"""

STARTS_US = (2**31 - 4000, 2**31, 2**32 - 4000, UNIX_US, MAX_START_US)
"""Two of them pass the ends of int32 and of uint32 in the middle of the film."""

LEVELS = (*USUAL, *USUAL)


def _capture(start_us: int, suffix: str, folder: Path | None = None) -> Events:
    """What leaves the camera, which `film` has found in the recording too."""

    def act(tick: int, world: World) -> None:
        place(world, min(tick, len(LEVELS) - 1) * FLASH_PX)

    seen = capture(
        grid_mjcf(LEVELS, FLASH_PX),
        len(LEVELS) * 1e-3,
        {
            "sensor": {"width": FLASH_PX, "height": HEIGHT_PX},
            "scene": {"start_us": start_us},
        },
        act,
        suffix,
        folder=folder,
    )
    return seen.events


QUEUE = 1 << 20
"""packets that may wait: nobody paces the player here, and a busy machine's listener is slow"""


class _Listener:
    """A subscriber in a thread of its own."""

    def __init__(self, address: str) -> None:
        self.received: list[Events] = []
        self.lost = -1
        self._address = address
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        with subscribe(self._address, timeout_s=20.0, queue=QUEUE) as subscription:
            self.received += [packet.events for packet in subscription]
            self.lost = subscription.lost

    def events(self) -> Events:
        """All that came until the publisher's end."""
        self._thread.join(timeout=30.0)
        return join_events(self.received)


def _played(file: Path) -> tuple[Events, int]:
    """A recording played on the bus: what a subscriber hears, and how many packets it lost."""
    # no port that another program could take first
    address = f"ipc://{file.with_name('bus')}"
    listener = _Listener(address)
    publisher = Publisher(address, wait_for=1, queue=QUEUE)
    try:
        publisher.open([stream_of(file)])
        for message in messages(file):
            if isinstance(message, EventPacket):
                publisher.write(message)
    finally:
        publisher.close()
    return listener.events(), listener.lost


def _later(events: Events, by_us: int) -> Events:
    moved = events.copy()
    moved["t"] += by_us
    return moved


def _starts(short: bool) -> Measurement:
    kinds = [kind for kind in formats.FORMATS if not kind.extra]
    if short:
        kinds = [kind for kind in kinds if kind.name in ("aedat4", "aedat2", "evt3", "npz")]
    usual = _capture(0, ".aedat4")
    wrong, notes = 0, []
    for start_us in (STARTS_US[0], UNIX_US) if short else STARTS_US:
        expected = _later(usual, start_us)
        for kind in kinds:
            wrong += len(np.setxor1d(_capture(start_us, kind.suffixes[0]), expected))
        with TemporaryDirectory() as name:
            _capture(start_us, ".aedat4", Path(name))
            received, lost = _played(Path(name) / "run.aedat4")
        missing = len(np.setxor1d(received, expected)) + abs(lost)
        wrong += missing
        if missing:
            notes.append(f"from {start_us} us on the bus: {len(received)} events, lost {lost}")
    again = _capture(0, ".aedat4")
    return Measurement(wrong, 0, "events", tuple(notes), np.array_equal(again, usual))


CASES = (
    StressCase(
        "start-times",
        "time",
        "scene.start_us of 2^31 us, 2^32 us, a Unix time and the year 2112, into every format, "
        "over the player and the bus",
        "the same events, that much later, to the microsecond",
        _starts,
    ),
)
