"""Addresses of the bus: tcp://HOST:PORT, and without keys only this machine's own to publish on."""

from __future__ import annotations

import ipaddress
import re
import socket

from evs.msgs import DEFAULT_ADDRESS, EvsError

_FORM = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):(\*|[0-9]{1,5})")


def bindable(address: str, open_to_others: bool = False, *, does: str = "publish") -> str:
    """The address to bind for tcp://HOST:PORT, port 0 or * for any free one.

    In: open_to_others, it has keys, or its owner knows that it has none; does, what is done there,
    as errors say it. Raises EvsError for another form and, unless so, for a host that other
    machines could reach and then read.
    """
    host, port = _parts(address)
    if host == "localhost":
        host = "127.0.0.1"
    try:
        local = ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        local = False
    if not (local or open_to_others):
        raise EvsError(
            f"cannot {does} on '{address}': only this machine's own address is safe without keys; "
            f"use tcp://127.0.0.1:{port}, and from another machine ssh -L {port}:127.0.0.1:{port}; "
            "or give it a key (evs keygen makes one), or insecure=true if anybody may listen"
        )
    return f"tcp://{host}:{'0' if port == '*' else port}"


def connectable(address: str) -> str:
    """The address to connect to for tcp://HOST:PORT. Raises EvsError for another form or host."""
    host, port = _parts(address)
    if port in ("*", "0"):
        raise EvsError(f"address '{address}' has no port to connect to: give the publisher's")
    try:
        socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise EvsError(
            f"no machine '{host}' is known: check the address '{address}', e.g. {DEFAULT_ADDRESS}"
        ) from None
    return f"tcp://{host}:{port}"


def is_ipv6(address: str) -> bool:
    """Whether tcp://HOST:PORT names its host by an IPv6 number."""
    return address.startswith("tcp://[")


def _parts(address: str) -> tuple[str, str]:
    form = _FORM.fullmatch(address)
    if form is None:
        raise EvsError(
            f"address '{address}' is not of the form tcp://HOST:PORT, e.g. {DEFAULT_ADDRESS}"
        )
    host, port = form.group(1), form.group(2)
    # ZeroMQ would take 99999 for 34463
    if port != "*" and int(port) > 65535:
        raise EvsError(f"address '{address}' has port {port}: ports end at 65535")
    return host, port if port == "*" else str(int(port))
