"""An address on this machine that nobody uses: for a publisher and subscriber started together."""

from __future__ import annotations

import socket

from evs.msgs import EvsError


def free_address() -> str:
    """tcp://127.0.0.1:PORT with a port that is free now.

    A publisher that binds port 0 knows its port only once it is open; here the subscriber, which
    may connect first, has to know it before.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.bind(("127.0.0.1", 0))
            return f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    except OSError as reason:
        raise EvsError(
            f"no free port on 127.0.0.1: {reason.strerror}; the loopback device must be up"
        ) from None
