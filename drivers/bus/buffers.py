"""Memory that large frames are sent from, used again: fresh pages would cost more than the copy."""

from __future__ import annotations

import numpy as np
import zmq

LEAST_BYTES = 512 * 1024
"""ZeroMQ's own copy of a shorter frame is quicker than lending it memory."""

MOST_BYTES = 64 * 1024 * 1024
"""Kept at most; what waits for slow subscribers beyond it is ZeroMQ's own copy."""


class Buffers:
    """Copies of frames, in memory that is taken back once nobody waits for the frame."""

    def __init__(self) -> None:
        self.bytes = 0
        """memory kept"""
        self._lent: list[tuple[memoryview, zmq.MessageTracker]] = []

    def copied(self, raw: memoryview) -> memoryview | zmq.Frame:
        """What to send so that `raw`, of format B, may change afterwards."""
        if raw.nbytes < LEAST_BYTES:
            return raw
        memory = self._free(raw.nbytes)
        if memory is None:
            return raw
        memory[: raw.nbytes] = raw
        frame = zmq.Frame(memory[: raw.nbytes], copy=False, track=True)
        assert frame.tracker is not None
        # not the frame: its memory is free once nobody has it any more, and we are somebody
        self._lent.append((memory, frame.tracker))
        return frame

    def _free(self, size: int) -> memoryview | None:
        """Memory of at least `size` bytes that nobody has; None: so much may not be kept."""
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
