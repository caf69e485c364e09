"""Reused memory that large frames are sent from: fresh pages would cost more than the copy."""

from __future__ import annotations

import numpy as np
import zmq

LEAST_BYTES = 512 * 1024
"""ZeroMQ copies shorter frames itself, which is faster than lending it memory."""

MOST_BYTES = 64 * 1024 * 1024
"""Most memory; ZeroMQ itself copies what waits for slow subscribers beyond it."""


class Buffers:
    """Copies frames into memory that is used again once no subscriber waits for the frame."""

    def __init__(self) -> None:
        self.bytes = 0
        """memory in use"""
        self._lent: list[tuple[memoryview, zmq.MessageTracker]] = []

    def copied(self, raw: memoryview) -> memoryview | zmq.Frame:
        """Return what to send so that `raw`, of format B, may change afterwards."""
        if raw.nbytes < LEAST_BYTES:
            return raw
        memory = self._free(raw.nbytes)
        if memory is None:
            return raw
        memory[: raw.nbytes] = raw
        frame = zmq.Frame(memory[: raw.nbytes], copy=False, track=True)
        assert frame.tracker is not None
        # the tracker, not the frame: a reference to the frame would keep its memory in use
        self._lent.append((memory, frame.tracker))
        return frame

    def _free(self, size: int) -> memoryview | None:
        """Return free memory of at least `size` bytes; None if MOST_BYTES are in use."""
        for place, (memory, tracker) in enumerate(self._lent):
            if tracker.done:
                del self._lent[place]
                if memory.nbytes >= size:
                    return memory
                # a larger one takes its place
                self.bytes -= memory.nbytes
                break
        if self.bytes + size > MOST_BYTES:
            return None
        # room for the next ones, which are seldom of quite this size
        room = min(size + size // 4, MOST_BYTES - self.bytes)
        self.bytes += room
        return np.empty(room, np.uint8).data
