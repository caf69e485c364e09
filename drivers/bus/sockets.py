"""What both ends of the bus share: options of sockets, parts of messages, the check of events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import zmq
from zmq.backend import Socket as _Core
from zmq.backend import zmq_poll
from zmq.utils.monitor import recv_monitor_message

from evs.drivers.clock import monotonic_s
from evs.msgs.packet import QuickCheck

Socket = zmq.Socket[bytes]
Context = zmq.Context[Socket]

PATIENCE_S = 30
"""How long the other end may be silent, or may accept none of the data that wait for it, s.

A slow link with much traffic takes its time.
"""
CONNECT_MS = 5000
"""How long one attempt to connect may take: the system's own pauses grow to a minute."""
_MOST_PARTS = 3
"""topic, header, raw frame"""
_COPIED_BYTES = 64 * 1024
"""A shorter frame is copied faster than its memory is lent."""
# plain integers: combining flags of an enumeration takes longer than sending a message
_READABLE = int(zmq.POLLIN)
_AT_ONCE = int(zmq.NOBLOCK)
_AND_MORE = int(zmq.NOBLOCK | zmq.SNDMORE)
# the method around it only handles arguments that we never pass
_send = _Core.send
_TORN = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
_REFUSED = zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_AUTH
_MOST_TORN = 3
"""So many in a row are a refusal, too; one is torn when a publisher ends."""


def notice_death(socket: Socket) -> None:
    """Detect a link that is cut, which TCP alone takes for a silent one; before it connects.

    A client connects again, a publisher frees what it held for a client. The probes are TCP's, not
    ZeroMQ's: libzmq to 4.3.5 at least ends the process when a heartbeat is due on a connection that
    has failed while the queue behind it was full.
    """
    pause_s = PATIENCE_S // 6
    socket.set(zmq.TCP_KEEPALIVE, 1)
    # nothing to send: the first probe after two pauses, then four more
    socket.set(zmq.TCP_KEEPALIVE_IDLE, 2 * pause_s)
    socket.set(zmq.TCP_KEEPALIVE_INTVL, pause_s)
    socket.set(zmq.TCP_KEEPALIVE_CNT, 4)
    # something to send, which the other end does not accept
    socket.set(zmq.TCP_MAXRT, 1000 * PATIENCE_S)
    socket.set(zmq.CONNECT_TIMEOUT, CONNECT_MS)


def serve_anybody(socket: Socket) -> None:
    """Let no stranger fill a server's inbound queue; before it is bound.

    It has no bound: libzmq to 4.3.5 at least ends the process when a client that has gone had sent
    a heartbeat behind a full queue. A message of endless frames has always cost as much memory.
    """
    notice_death(socket)
    socket.set(zmq.RCVHWM, 0)


def readable(socket: Socket) -> bool:
    """Return whether a message can be read now. The option of the socket is slower."""
    return bool(zmq_poll([(socket, _READABLE)], 0))


def send_parts(socket: Socket, parts: Sequence[bytes | memoryview | zmq.Frame]) -> None:
    """Send a message without waiting: a client with a full queue does not get it."""
    *first, last = parts
    for part in first:
        _send(socket, part, _AND_MORE)
    _send(socket, last, _AT_ONCE)


def receive_parts(socket: Socket) -> list[Any]:
    """Receive the parts of a message that is there: bytes; a long third one as a memoryview.

    Of a message with more parts than any of ours, one too many is returned: enough to refuse it.
    """
    parts: list[Any] = []
    more = True
    while more:
        # a frame knows whether it is the last; the socket's option takes longer than the copy
        frame = socket.recv(_AT_ONCE, copy=False)
        more = frame.more
        if len(parts) <= _MOST_PARTS:
            long = len(parts) >= _MOST_PARTS - 1 and len(frame) > _COPIED_BYTES
            parts.append(frame.buffer.toreadonly() if long else frame.bytes)
    return parts


class Handshakes:
    """Follows a client's connections: whether a server is there, and accepts it."""

    def __init__(self, client: Socket) -> None:
        self.refused = False
        """Whether the other end refuses this client."""
        self.connected = False
        """Whether it did at the last update; a cut link is noticed after PATIENCE_S."""
        self.closed_s: float | None = None
        """When the connection closed that there was, s; None: it is there, or never was."""
        self._torn = 0
        self._client = client
        wanted = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED | _TORN | _REFUSED
        self.socket: Socket = client.get_monitor_socket(wanted)

    def update(self) -> None:
        """Read the events since the last call."""
        while readable(self.socket):
            event = recv_monitor_message(self.socket, zmq.NOBLOCK)["event"]
            if event == zmq.EVENT_DISCONNECTED and self.connected:
                self.closed_s = monotonic_s()
            self.connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            if event == zmq.EVENT_DISCONNECTED:
                continue
            if self.connected:
                self.closed_s = None
            self._torn = self._torn + 1 if event == _TORN else 0
            # after these two ZeroMQ does not try again
            self.refused = bool(event & _REFUSED) or self._torn >= _MOST_TORN

    def close(self) -> None:
        """Stop watching; before the client is closed."""
        self._client.disable_monitor()
        self.socket.close(linger=0)


def quick_check() -> QuickCheck:
    """Return the native check of the events of a packet, which costs far less than numpy's.

    It only accepts or rejects; msgs.packet.check_events finds the words of the error.
    """
    # imported here, so that the core is loaded only where a bus is opened
    from evs.emulator import _core

    return _core.events_fit
