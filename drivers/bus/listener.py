"""Listener, the base of all clients of a publisher: keys, sockets, waiting, closing."""

from __future__ import annotations

import math
import select
from collections.abc import Iterable
from types import TracebackType
from typing import Self

import zmq

from evs.drivers.bus.address import connectable, is_ipv6
from evs.drivers.bus.curve_keys import new_keys, present, read_public, read_secret
from evs.drivers.bus.sockets import Context, Handshakes, Socket, notice_death, readable
from evs.drivers.clock import monotonic_s
from evs.msgs import EvsError

_LONGEST_POLL_MS = 1000


class Listener:
    """One or more connections to a publisher. One thread uses it; close it, or use `with`."""

    def __init__(self, address: str, server_key: str, key: str) -> None:
        """Check the arguments; see `subscribe`. Raises EvsError for an invalid address or key."""
        if key and not server_key:
            raise EvsError("key needs server_key: give the publisher's public key")
        self._server_key = read_public(server_key, "server_key") if server_key else ""
        self._keys = read_secret(key) if key else new_keys() if server_key else None
        self.address = connectable(address)
        self._context: Context | None = Context()
        self._connections: list[Socket] = []
        self._handshakes: Handshakes | None = None
        # the system's own, with a socket's descriptor: it takes far less than ZeroMQ's
        self._poller = select.poll()
        self._stirred: set[Socket] = set()
        """sockets with news since they were last empty; a descriptor reports each only once"""
        self._sockets: dict[int, Socket] = {}
        """of each descriptor"""

    @property
    def connected(self) -> bool:
        """Whether the publisher was there at the last wait.

        A publisher that ends is noticed at once, a link that is cut after half a minute.
        """
        return self._handshakes is not None and self._handshakes.connected

    def close(self) -> None:
        """Close all connections. Safe to call twice."""
        if self._context is not None:
            if self._handshakes is not None:
                self._handshakes.close()
            for connection in self._connections:
                connection.close(linger=0)
            self._context.term()
            self._context = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _listen(self, topics: Iterable[bytes], largest: int, options: dict[int, int]) -> Socket:
        """Open another connection; the first one shows whether the publisher accepts us.

        Args:
            topics: To subscribe to.
            largest: Bytes of a message, so that a stranger at that address cannot fill our memory.
            options: Of the socket.
        """
        assert self._context is not None
        client = self._context.socket(zmq.SUB)
        for option, value in options.items():
            client.set(option, value)
        notice_death(client)
        client.set(zmq.MAXMSGSIZE, largest)
        client.set(zmq.IPV6, int(is_ipv6(self.address)))
        for topic in topics:
            client.subscribe(topic)
        if self._keys is not None:
            present(client, self._server_key, self._keys)
        if self._handshakes is None:
            self._handshakes = Handshakes(client)
            self._watch(self._handshakes.socket)
        self._watch(client)
        self._connections.append(client)
        client.connect(self.address)
        return client

    def _watch(self, socket: Socket) -> None:
        descriptor = int(socket.get(zmq.FD))
        self._poller.register(descriptor, select.POLLIN)
        self._sockets[descriptor] = socket
        self._stirred.add(socket)

    def _has_news(self, socket: Socket) -> bool:
        """Return whether a message can be read, as far as the last `_poll` knows."""
        if socket not in self._stirred:
            return False
        if readable(socket):
            return True
        self._stirred.discard(socket)
        return False

    def _poll(self, until_s: float) -> None:
        """Wait for a message until `until_s`. Raises EvsError where the publisher refuses us.

        Every connection was read until it was empty before, or has had no news since.
        """
        self._check_welcome()
        wait_ms = math.ceil(min(1000 * (until_s - monotonic_s()), _LONGEST_POLL_MS))
        for descriptor, _ in self._poller.poll(max(0, wait_ms)):
            self._stirred.add(self._sockets[descriptor])
        self._check_welcome()

    def _check_welcome(self) -> None:
        """Raise EvsError if the publisher refuses us."""
        if self._handshakes is None:
            return
        if self._handshakes.socket in self._stirred:
            self._handshakes.update()
            self._stirred.discard(self._handshakes.socket)
        if self._handshakes.refused:
            if self._server_key:
                why = "server_key is not its public key, or it does not allow yours"
                why += ", or it has no keys"
            else:
                why = "it wants keys (give server_key, its public key), or it is no publisher"
            raise EvsError(f"the program at {self.address} does not let us in: {why}")
