"""Exact counts of what a subscriber lost of one camera's stream, from the messages alone.

Messages of one connection arrive in order, and a full queue loses the newest ones. So a gap in seq
is a loss, and so is a seq of a status that was never reached. Messages sent before the first one
arrived are no loss: the subscriber was not there. A seq or a time that goes back is a new run.
"""

from __future__ import annotations

from dataclasses import dataclass

from evs.msgs import EventPacket, Status


@dataclass
class Tally:
    """Counts of one camera's stream. With `ended`, packets + lost is the number sent meanwhile."""

    packets: int = 0
    """Packets received."""
    events: int = 0
    """Events in them."""
    lost: int = 0
    """Packets that were sent and never arrived, as far as known."""
    restarts: int = 0
    """How often the camera began a new run."""
    ended: bool = False
    """The end status came: nothing follows."""
    next_seq: int | None = None
    """The next packet's seq if nothing is lost; None before the first message."""
    time_us: int = 0
    """Simulated time at the end of the last packet, us."""
    promised_end: Status | None = None
    """An end status that came by another connection, so packets sent before it may still follow."""

    def on_packet(self, packet: EventPacket) -> None:
        """Count a packet, which arrived on the main connection."""
        if self._goes_back(packet.seq, packet.time_base_us):
            self._new_run()
        if self.next_seq is not None:
            self.lost += packet.seq - self.next_seq
        self.next_seq, self.time_us = packet.seq + 1, packet.time_end_us
        self.packets += 1
        self.events += len(packet.events)

    def on_status(self, status: Status) -> None:
        """Count a status among the packets: what was sent before it has arrived or is lost."""
        if self._goes_back(status.seq + 1, status.time_end_us):
            self._new_run()
        if self.next_seq is not None:
            self.lost += status.seq + 1 - self.next_seq
        self.next_seq, self.time_us = status.seq + 1, status.time_end_us
        self.ended = status.end

    def on_side_status(self, status: Status) -> None:
        """Note a status of the side connection, which may be ahead of packets sent before it."""
        if status.end and not self.ended:
            self.promised_end = status

    @property
    def complete(self) -> bool:
        """Whether everything that was sent has arrived, or is known to be lost."""
        promised = self.promised_end
        return self.ended or (promised is not None and promised.seq + 1 == self.next_seq)

    def settle(self) -> Status | None:
        """Count missing packets of a run that has ended as lost: no more will come.

        Returns:
            The end status; None if the end is already known.
        """
        promised, self.promised_end = self.promised_end, None
        if promised is None or self.ended:
            return None
        self.on_status(promised)
        return promised

    def _goes_back(self, seq: int, time_us: int) -> bool:
        return self.next_seq is not None and (seq < self.next_seq or time_us < self.time_us)

    def _new_run(self) -> None:
        """Begin a new run; what it sent before this message is no loss."""
        promised, self.promised_end = self.promised_end, None
        if promised is not None and not self.ended and self.next_seq is not None:
            self.lost += max(0, promised.seq + 1 - self.next_seq)
        self.restarts += 1
        self.next_seq = None
        self.ended = False


@dataclass
class Gaps:
    """Losses of one camera's messages of another topic, from gaps in seq and from statuses."""

    count: int = 0
    """Messages received."""
    lost: int = 0
    """Messages that a gap shows."""
    next_seq: int | None = None
    """The next message's seq if nothing is lost; None before the first."""

    def on_last(self, seq: int) -> None:
        """Count with the last seq of a status: everything sent before has arrived or is lost."""
        if self.next_seq is not None and seq >= self.next_seq:
            self.lost += seq + 1 - self.next_seq
            self.next_seq = seq + 1

    def on_message(self, seq: int) -> None:
        """Count a message; a smaller seq means a new run."""
        if self.next_seq is not None and seq > self.next_seq:
            self.lost += seq - self.next_seq
        self.next_seq = seq + 1
        self.count += 1
