"""What a page is shown of a bus: the last event of each pixel, rates, the light, and clips."""

from __future__ import annotations

import json
import struct
import tempfile
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.bus import Subscription
from evs.drivers.clock import monotonic_s
from evs.msgs import EventPacket, EvsError, Frame, StreamInfo, unknown

CLIP_S = 10.0
"""simulated time of which events are kept, to be saved"""

CLIP_BYTES = 64 * 2**20
"""they take at most this, of each camera"""

_NEVER = np.iinfo(np.int64).min
_WAIT_S = 0.05


class PixelNews:
    """The last event of each pixel since a page got them; bounded, however slow the page is."""

    def __init__(self, width: int, height: int) -> None:
        self.size = width, height
        self._t = np.full(width * height, _NEVER, np.int64)
        self._p = np.zeros(width * height, np.uint32)
        self._is_new = False

    def add(self, packet: EventPacket) -> None:
        """Add the events of a packet."""
        events = packet.events
        places = events["y"].astype(np.int64) * self.size[0] + events["x"]
        # of several events of a pixel numpy keeps the last
        self._t[places] = events["t"]
        self._p[places] = events["p"].astype(np.uint32)
        self._is_new = self._is_new or len(events) > 0

    def take(self, now_us: int) -> npt.NDArray[np.uint32]:
        """Return the pixels that fired since the last call.

        Args:
            now_us: Simulated time from which ages count.

        Returns:
            (n, 2) uint32: place in the picture, row by row, times 2 plus polarity; age, us.
        """
        if not self._is_new:
            return np.zeros((0, 2), np.uint32)
        places = np.flatnonzero(self._t != _NEVER)
        ages = np.clip(now_us - self._t[places], 0, 2**32 - 1)
        found = np.stack(
            [places.astype(np.uint32) * 2 + self._p[places], ages.astype(np.uint32)], 1
        )
        self._t[places] = _NEVER
        self._is_new = False
        return found


class CameraFeed:
    """The newest of one camera, and what its clips are made of."""

    def __init__(self, packet: EventPacket) -> None:
        self.name, self.width, self.height = packet.camera, packet.width, packet.height
        self.t_us = packet.time_base_us
        self.came_s = 0.0
        """when its newest packet came, by the wall clock"""
        self.on = self.off = 0
        """events so far"""
        self.light: Frame | None = None
        self.lights = 0
        """pictures of the light so far"""
        self.new: list[EventPacket] = []
        """packets that no page has got"""
        self._new_bytes = 0
        self._kept: deque[EventPacket] = deque()
        self._kept_bytes = 0

    def add(self, packet: EventPacket) -> None:
        """Add a packet."""
        if packet.time_end_us < self.t_us:
            # another run, or a reset
            self._kept.clear()
            self._kept_bytes = 0
        self.t_us, self.came_s = packet.time_end_us, monotonic_s()
        on = int(np.count_nonzero(packet.events["p"]))
        self.on += on
        self.off += len(packet) - on
        self.new.append(packet)
        self._new_bytes += packet.events.nbytes
        while self._new_bytes > CLIP_BYTES:
            self._new_bytes -= self.new.pop(0).events.nbytes
        self._kept.append(packet)
        self._kept_bytes += packet.events.nbytes
        while self._kept_bytes > CLIP_BYTES or (
            self.t_us - self._kept[0].time_base_us > CLIP_S * 1e6 and len(self._kept) > 1
        ):
            self._kept_bytes -= self._kept.popleft().events.nbytes

    def take_new(self) -> list[EventPacket]:
        """Return the packets that came since the last call."""
        taken, self.new, self._new_bytes = self.new, [], 0
        return taken

    def kept(self, seconds: float) -> list[EventPacket]:
        """Return the packets of the last seconds of simulated time, as far as they are kept."""
        begin_us = self.t_us - seconds * 1e6
        return [packet for packet in self._kept if packet.time_end_us > begin_us]


class BusFeed:
    """Receives a bus in a thread of its own, as long as it is entered."""

    def __init__(self, stream: Subscription, timeout_s: float | None = None) -> None:
        """Make a feed that does not receive yet.

        Args:
            stream: What it receives; nobody else uses it any more.
            timeout_s: It ends after so many seconds without a packet; None: it waits for ever.
        """
        self.lock = threading.Lock()
        """held while cameras are read or changed"""
        self.cameras: dict[str, CameraFeed] = {}
        self.lost = 0
        """packets that did not arrive"""
        self.failure: EvsError | None = None
        """why nothing more comes: the publisher refuses us"""
        self.ended = False
        """nothing more comes"""
        self._stream, self._timeout_s = stream, timeout_s
        self._closing = False
        self._thread = threading.Thread(target=self._receive, name="evs page feed", daemon=True)

    def __enter__(self) -> BusFeed:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._thread.join()

    def _receive(self) -> None:
        came_s = monotonic_s()
        try:
            while not self._closing and not self._stream.ended:
                packet = self._stream.receive(_WAIT_S)
                if packet is not None:
                    came_s = monotonic_s()
                    with self.lock:
                        self._take(packet)
                elif self._timeout_s is not None and monotonic_s() - came_s > self._timeout_s:
                    break
        except EvsError as error:
            self.failure = error
        self.ended = True

    def _take(self, packet: EventPacket) -> None:
        camera = self.cameras.get(packet.camera)
        if camera is None or (camera.width, camera.height) != (packet.width, packet.height):
            camera = self.cameras[packet.camera] = CameraFeed(packet)
        camera.add(packet)
        self.lost = self._stream.lost
        for picture in (*self._stream.frames, *self._stream.lights):
            if of := self.cameras.get(picture.camera):
                of.light, of.lights = picture, of.lights + 1

    def clip(self, camera: str, seconds: float) -> bytes:
        """Return the events of the last seconds of a camera as an AEDAT4 file.

        Raises:
            EvsError: No such camera, or nothing has come from it.
        """
        from evs.drivers.files import recorder_for

        with self.lock:
            if camera not in self.cameras:
                raise unknown("camera", camera, self.cameras)
            of = self.cameras[camera]
            packets = of.kept(min(max(seconds, 0.0), CLIP_S))
            stream = StreamInfo(of.width, of.height, camera)
        with tempfile.TemporaryDirectory(prefix="evs-clip-") as folder:
            file = Path(folder) / "clip.aedat4"
            with closing(recorder_for(file)) as sink:
                sink.open([stream])
                for packet in packets:
                    sink.write(packet)
            return file.read_bytes()


_LENGTH = struct.Struct("<I")


def picture_message(
    header: dict[str, Any], events: npt.NDArray[np.uint32], light: Frame | None
) -> bytes:
    """Make one binary message for a page.

    Args:
        header: Plain values; the numbers of events and of bytes of light are added.
        events: (n, 2) as in PixelNews.take.
        light: A picture of the light; None: it has not changed.

    Returns:
        Length of the header, a little-endian uint32; the header, JSON in UTF-8, padded with blanks
        so that what follows is at a multiple of 4; the events; a byte a pixel of light.
    """
    grey = b""
    if light is not None:
        pixels = light.pixels
        grey = (pixels >> 8 if pixels.dtype.itemsize == 2 else pixels).astype(np.uint8).tobytes()
    text = json.dumps({**header, "events": len(events), "light": len(grey)}).encode()
    text += b" " * (-len(text) % 4)
    return b"".join((_LENGTH.pack(len(text)), text, events.astype("<u4").tobytes(), grey))


def names_of(feeds: Sequence[CameraFeed]) -> list[dict[str, Any]]:
    """Describe cameras for a page."""
    return [{"name": one.name, "width": one.width, "height": one.height} for one in feeds]
