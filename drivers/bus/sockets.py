"""Small things that both ends of the bus do with their sockets."""

from __future__ import annotations

import zmq

Socket = zmq.Socket[bytes]
Context = zmq.Context[Socket]


def readable(socket: Socket) -> bool:
    """Whether a message can be taken now. Costs 3 us, where a poll costs 10."""
    return bool(int(socket.get(zmq.EVENTS)) & zmq.POLLIN)
