"""One TCP port that gives one stream to any number of clients."""

from __future__ import annotations

import selectors
import socket

from evs.drivers.dv.clients import Client, Sent
from evs.msgs import EvsError

MAX_CLIENTS = 64
"""Of one stream; who comes after them is hung up on, and counted."""


class Port:
    """A listening socket and its clients. Nothing here waits but `linger`, its caller's choice."""

    def __init__(
        self,
        host: str,
        number: int,
        header: bytes,
        queue: int,
        selector: selectors.BaseSelector,
        patience_s: float,
    ) -> None:
        """Bind. EvsError: the port is in use, or the host not this machine's."""
        self.sent = Sent()
        self.clients: list[Client] = []
        self.came = 0
        """clients so far"""
        self.refused = 0
        self._header, self._queue, self._selector = header, queue, selector
        self._patience_s = patience_s
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            # a port that a run just left may be taken again at once
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

    def read(self, client: Client | None) -> None:
        """Accept a new client (None), or read what a client sent; it may have left."""
        if client is None:
            self._accept()
        elif not client.read():
            self._drop(client)

    def send(self, message: bytes, elements: int) -> None:
        """Give one message to every client, as far as each takes it now."""
        for client in tuple(self.clients):
            client.put(message, elements)
            self._flush(client)

    def flush(self) -> None:
        """Send what waits, as far as the clients take it now."""
        for client in tuple(self.clients):
            if client.is_waiting:
                self._flush(client)

    @property
    def is_waiting(self) -> bool:
        """Whether any client has something to come."""
        return any(client.is_waiting for client in self.clients)

    def waiting_links(self) -> list[socket.socket]:
        """The sockets of those that have."""
        return [client.link for client in self.clients if client.is_waiting]

    def close(self) -> None:
        """Hang up on every client and give the port back."""
        for client in tuple(self.clients):
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        try:
            link, _ = self._listener.accept()
        except OSError:
            # it knocked and went away, or this process has no file descriptor left for it
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
        if not client.flush():
            self._drop(client)

    def _drop(self, client: Client) -> None:
        self._selector.unregister(client.link)
        self.clients.remove(client)
        client.close()
