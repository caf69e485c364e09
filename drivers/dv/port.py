"""One TCP port that gives one stream to any number of clients, each with its own bounded queue.

A client that is too slow loses the oldest messages. Nothing here waits.
"""

from __future__ import annotations

import selectors
import socket
from collections import deque
from dataclasses import dataclass

from evs.msgs import EvsError

MAX_QUEUE_BYTES = 64 * 1024 * 1024
"""Most bytes that wait for one client; a single message may be larger."""

PATIENCE_S = 300.0
"""How long a client may read nothing before it is disconnected. A cut cable gives no sign, and a
client may be stopped in a debugger."""

_MOST_PATIENCE_S = 5 * 32767.0
"""the operating system has no longer pauses"""
_RECEIVE_BYTES = 4096


@dataclass
class Sent:
    """Counts over all clients of a stream."""

    packets: int = 0
    """messages that the operating system took whole"""
    bytes: int = 0
    packets_dropped: int = 0
    elements_dropped: int = 0
    """events, frames, samples or triggers in them"""


class Client:
    """A connection to a client that only reads."""

    def __init__(
        self,
        link: socket.socket,
        header: bytes,
        queue: int,
        sent: Sent,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Serve a new connection.

        Args:
            link: A connected socket.
            header: The bytes that the client receives first.
            queue: How many messages may wait.
            sent: The counts of the stream.
            patience_s: After how long without reading the client is disconnected, s.
        """
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _notice_death(link, patience_s)
        self.link = link
        self._queue, self._sent = queue, sent
        # a message that was begun must be completed, or the client loses its place in the stream
        self._begun = memoryview(header)
        self._begun_elements = -1
        """-1: it is the header"""
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._waiting_bytes = 0
        self.is_full = False
        """Whether the operating system took no more; it is asked again once it has room."""

    @property
    def is_waiting(self) -> bool:
        """Whether something is left to send."""
        return bool(self._begun or self._waiting)

    def put(self, message: bytes, elements: int) -> None:
        """Queue one message; where the queue is full, the oldest ones are dropped."""
        self._waiting.append((message, elements))
        self._waiting_bytes += len(message)
        while len(self._waiting) > self._queue or (
            self._waiting_bytes > MAX_QUEUE_BYTES and len(self._waiting) > 1
        ):
            oldest, lost = self._waiting.popleft()
            self._waiting_bytes -= len(oldest)
            self._sent.packets_dropped += 1
            self._sent.elements_dropped += lost

    def flush(self) -> bool:
        """Send what the operating system takes; return False once the client is gone."""
        self.is_full = False
        try:
            while self._begun or self._begin():
                done = self.link.send(self._begun)
                self._sent.bytes += done
                self._begun = self._begun[done:]
                if not self._begun:
                    self._sent.packets += self._begun_elements >= 0
        except BlockingIOError:
            self.is_full = True
        except OSError:
            return False
        return True

    def read(self) -> bool:
        """Discard what it sends, which means nothing; return False once it has left."""
        try:
            return bool(self.link.recv(_RECEIVE_BYTES))
        except BlockingIOError:
            return True
        except OSError:
            return False

    def close(self) -> None:
        """Close the connection; messages that still wait are dropped and counted."""
        if self._begun and self._begun_elements >= 0:
            self._waiting.append((b"", self._begun_elements))
        self._sent.packets_dropped += len(self._waiting)
        self._sent.elements_dropped += sum(elements for _, elements in self._waiting)
        self._waiting.clear()
        self._begun = memoryview(b"")
        self.link.close()

    def _begin(self) -> bool:
        if not self._waiting:
            return False
        message, self._begun_elements = self._waiting.popleft()
        self._waiting_bytes -= len(message)
        self._begun = memoryview(message)
        return True


def _notice_death(link: socket.socket, patience_s: float) -> None:
    """Have the operating system detect a client that is gone; by default that takes hours."""
    link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    patience_s = min(patience_s, _MOST_PATIENCE_S)
    pause_s = max(1, round(patience_s / 5))
    for name, value in (
        # nothing to send: probe after a pause, then four times
        ("TCP_KEEPIDLE", pause_s),
        ("TCP_KEEPINTVL", pause_s),
        ("TCP_KEEPCNT", 4),
        # something to send, and the client reads nothing
        ("TCP_USER_TIMEOUT", round(1000 * patience_s)),
    ):
        # not every system has every one
        if hasattr(socket, name):
            link.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


MAX_CLIENTS = 64
"""Most clients of a stream; further ones are disconnected at once, and counted."""


class Port:
    """A listening socket and its clients."""

    def __init__(
        self,
        host: str,
        number: int,
        header: bytes,
        queue: int,
        selector: selectors.BaseSelector,
        patience_s: float,
    ) -> None:
        """Bind the port.

        Args:
            host: Address of a network interface of this machine.
            number: The port; 0: a free one.
            header: The bytes that each client receives first.
            queue: How many messages may wait for each client.
            selector: Where the sockets are registered, with (self, client or None).
            patience_s: After how long without reading a client is disconnected, s.

        Raises:
            EvsError: The port is in use, or the host is not this machine's.
        """
        self.sent = Sent()
        self.clients: list[Client] = []
        self.came = 0
        """number of clients so far"""
        self.refused = 0
        self._header, self._queue, self._selector = header, queue, selector
        self._patience_s = patience_s
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            # the port of a run that has just ended can be bound again at once
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((host, number))
            self._listener.listen(MAX_CLIENTS)
        except OSError as reason:
            self._listener.close()
            raise EvsError(
                f"cannot serve DV on {host} port {number}: {reason.strerror}; "
                "give another address, or stop what uses this one"
            ) from None
        self._listener.setblocking(False)
        self.number = int(self._listener.getsockname()[1])
        selector.register(self._listener, selectors.EVENT_READ, (self, None))

    def serve(self, client: Client | None, events: int) -> None:
        """Accept a new client (None), or read from one and send to it, as the selector has it."""
        if client is None:
            self._accept()
            return
        if events & selectors.EVENT_READ and not client.read():
            self._drop(client)
        elif events & selectors.EVENT_WRITE:
            self._flush(client)

    def send(self, message: bytes, elements: int) -> None:
        """Send one message to every client, as far as each can take it now.

        A client whose connection is full costs an entry in its queue, and no call of the system.
        """
        for client in tuple(self.clients):
            client.put(message, elements)
            if not client.is_full:
                self._flush(client)

    @property
    def is_waiting(self) -> bool:
        """Whether messages wait for any client."""
        return any(client.is_waiting for client in self.clients)

    def close(self) -> None:
        """Disconnect every client and release the port."""
        for client in tuple(self.clients):
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        try:
            link, _ = self._listener.accept()
        except OSError:
            # the client is gone already, or this process has no file descriptor left
            self.refused += 1
            return
        if len(self.clients) >= MAX_CLIENTS:
            self.refused += 1
            link.close()
            return
        client = Client(link, self._header, self._queue, self.sent, self._patience_s)
        self.came += 1
        self.clients.append(client)
        self._selector.register(link, selectors.EVENT_READ, (self, client))
        self._flush(client)

    def _flush(self, client: Client) -> None:
        was_full = client.is_full
        if not client.flush():
            self._drop(client)
        elif client.is_full != was_full:
            wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.is_full else 0)
            self._selector.modify(client.link, wanted, (self, client))

    def _drop(self, client: Client) -> None:
        self._selector.unregister(client.link)
        self.clients.remove(client)
        client.close()
