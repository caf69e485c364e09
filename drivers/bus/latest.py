"""The newest state of a bus, on a port of its own: who reads slowly still reads the newest.

ZeroMQ's CONFLATE keeps one message a connection, the newest, at both ends.
"""

from __future__ import annotations

import math
from types import TracebackType

import zmq
from zmq.utils.monitor import recv_monitor_message

from evs.drivers.bus.address import connectable, is_ipv6
from evs.drivers.bus.keys import Keys, new_keys, present, read_public, read_secret
from evs.drivers.bus.sockets import Context, Handshakes, Socket, notice_death, readable
from evs.drivers.pace import monotonic_s
from evs.msgs import STATE_PREFIX, EvsError, MessageError, State, decode_state
from evs.msgs.state import MAX_STATE_BYTES

_KERNEL_BYTES = 16 * 1024
"""What the kernel may hold for a client that does not read: older states are of no use to it."""
_LONGEST_POLL_MS = 1000


class Watchers:
    """Counts the clients of a PUB socket, which, unlike XPUB, does not tell of subscriptions."""

    def __init__(self, server: Socket) -> None:
        self.count = 0
        self._server = server
        gone = zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED
        self.socket: Socket = server.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | gone)

    def look(self) -> int:
        """How many there are now."""
        while readable(self.socket):
            event = recv_monitor_message(self.socket, zmq.NOBLOCK)["event"]
            came = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            self.count = max(0, self.count + (1 if came else -1))
        return self.count

    def close(self) -> None:
        """Stop counting; before the server is closed."""
        self._server.disable_monitor()
        self.socket.close(linger=0)


def conflated(context: Context) -> Socket:
    """A PUB socket, not yet bound, that keeps the newest message for each client."""
    server: Socket = context.socket(zmq.PUB)
    server.set(zmq.CONFLATE, 1)
    server.set(zmq.SNDBUF, _KERNEL_BYTES)
    server.set(zmq.MAXMSGSIZE, 4096)
    return server


class Latest:
    """The newest state of the bus whose port for it is at tcp://HOST:PORT. Close it, or use `with`.

    `discover` tells the address. Keys are those of `subscribe`. One thread uses it.
    """

    def __init__(self, address: str, *, server_key: str = "", key: str = "") -> None:
        if key and not server_key:
            raise EvsError("key is of no use without server_key: give the publisher's public key")
        self.address = connectable(address)
        keys: Keys | None = None
        if server_key:
            keys = read_secret(key) if key else new_keys()
        self.bad_messages = 0
        """Messages that were not of our format; they were skipped."""
        self._context: Context | None = Context()
        self._client: Socket = self._context.socket(zmq.SUB)
        self._client.set(zmq.CONFLATE, 1)
        self._client.set(zmq.RCVBUF, _KERNEL_BYTES)
        notice_death(self._client)
        self._client.set(zmq.MAXMSGSIZE, MAX_STATE_BYTES + len(STATE_PREFIX))
        self._client.set(zmq.IPV6, int(is_ipv6(self.address)))
        if keys is not None:
            present(self._client, read_public(server_key, "server_key"), keys)
        self._client.subscribe(STATE_PREFIX)
        self._handshakes = Handshakes(self._client)
        self._poller = zmq.Poller()
        for heard in (self._client, self._handshakes.socket):
            self._poller.register(heard, zmq.POLLIN)
        self._client.connect(self.address)

    def get(self, timeout_s: float | None = 0.0) -> State | None:
        """The newest state that came since the last call; None if none comes in `timeout_s`.

        None waits for ever. Raises EvsError where the publisher does not let us in.
        """
        deadline_s = math.inf if timeout_s is None else monotonic_s() + timeout_s
        while self._context is not None:
            if readable(self._client):
                try:
                    return decode_state(self._client.recv(zmq.NOBLOCK))
                except MessageError:
                    self.bad_messages += 1
            self._handshakes.look()
            if self._handshakes.refused:
                raise EvsError(
                    f"the program at {self.address} does not let us in: are server_key and key "
                    "those that it knows?"
                )
            left_ms = 1000 * (deadline_s - monotonic_s())
            if left_ms <= 0:
                return None
            self._poller.poll(max(1, math.ceil(min(left_ms, _LONGEST_POLL_MS))))
        return None

    def close(self) -> None:
        """Stop listening. Safe to call twice."""
        if self._context is not None:
            self._handshakes.close()
            self._client.close(linger=0)
            self._context.term()
            self._context = None

    def __enter__(self) -> Latest:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
