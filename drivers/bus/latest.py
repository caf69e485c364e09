"""The newest state of a bus, on a port of its own: slow clients read the newest state, too.

ZeroMQ's CONFLATE keeps one message a connection, the newest, at both ends. One that is written in
the instant when the one before is read is lost; the next replaces it.
"""

from __future__ import annotations

import math

import zmq
from zmq.utils.monitor import recv_monitor_message

from evs.drivers.bus.listener import Listener
from evs.drivers.bus.sockets import Context, Socket, readable
from evs.drivers.clock import monotonic_s
from evs.msgs import STATE_PREFIX, MessageError, State, decode_state
from evs.msgs.state import MAX_STATE_BYTES

_KERNEL_BYTES = 16 * 1024
"""What the kernel may hold for a client that does not read: older states are of no use to it."""


class Watchers:
    """Counts the clients of a PUB socket, which, unlike XPUB, does not report subscriptions."""

    def __init__(self, server: Socket) -> None:
        self.count = 0
        self._server = server
        gone = zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED
        self.socket: Socket = server.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | gone)

    def update(self) -> int:
        """Return how many clients there are now."""
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
    """Return a PUB socket, not yet bound, that keeps the newest message for each client."""
    server: Socket = context.socket(zmq.PUB)
    server.set(zmq.CONFLATE, 1)
    server.set(zmq.SNDBUF, _KERNEL_BYTES)
    server.set(zmq.MAXMSGSIZE, 4096)
    return server


class Latest(Listener):
    """The newest state of a bus, from its port at tcp://HOST:PORT. Close it, or use `with`.

    `discover` returns the address. Keys are those of `subscribe`. One thread uses it.
    """

    def __init__(self, address: str, *, server_key: str = "", key: str = "") -> None:
        super().__init__(address, server_key, key)
        self.bad_messages = 0
        """Messages that were not of our format; they were skipped."""
        newest: dict[int, int] = {zmq.CONFLATE: 1, zmq.RCVBUF: _KERNEL_BYTES}
        self._client = self._listen([STATE_PREFIX], MAX_STATE_BYTES + len(STATE_PREFIX), newest)

    def get(self, timeout_s: float | None = 0.0) -> State | None:
        """Return the newest state since the last call.

        Args:
            timeout_s: Time to wait for it, s; None: for ever.

        Returns:
            The state; None if none came.

        Raises:
            EvsError: The publisher refuses us.
        """
        deadline_s = math.inf if timeout_s is None else monotonic_s() + timeout_s
        while self._context is not None:
            if readable(self._client):
                try:
                    return decode_state(self._client.recv(zmq.NOBLOCK))
                except MessageError:
                    self.bad_messages += 1
            if monotonic_s() >= deadline_s:
                self._check_welcome()
                return None
            self._poll(deadline_s)
        return None
