"""Addresses of the bus: tcp://HOST:PORT and ipc:///PATH.

Without keys, a publisher binds tcp only to addresses of this machine. ipc:// is a socket in the
file system, for programs of one machine: the kernel copies large packets over it two to three times
as fast. Every user who may write to the file may subscribe.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import stat
from pathlib import Path

from evs.msgs import DEFAULT_ADDRESS, EvsError

_FORM = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):(\*|[0-9]{1,5})")

_IPC = "ipc://"
_LONGEST_PATH = 107
"""bytes of a path that a socket of the file system may have"""


def bindable(address: str, open_to_others: bool = False, *, does: str = "publish") -> str:
    """Check an address to bind.

    Args:
        address: tcp://HOST:PORT, port 0 or * for any free one, or ipc:///PATH.
        open_to_others: Whether other machines may connect: there are keys, or the user said so.
        does: What is done there, for errors.

    Returns:
        The address in ZeroMQ's form.

    Raises:
        EvsError: It has another form, or other machines could reach it and may not.
    """
    if is_ipc(address):
        return _checked_path(address)
    host, port = _parts(address)
    if host == "localhost":
        host = "127.0.0.1"
    if not (_is_loopback(host.strip("[]")) or open_to_others):
        raise EvsError(
            f"cannot {does} on '{address}': only this machine's own address is safe without keys; "
            f"use tcp://127.0.0.1:{port}, and from another machine ssh -L {port}:127.0.0.1:{port}; "
            "or give it a key (evs keygen makes one), or insecure=true if anybody may listen"
        )
    return f"tcp://{host}:{'0' if port == '*' else port}"


def plain_tcp(address: str, insecure: bool, protocol: str) -> tuple[str, int]:
    """Return host and port to bind for a protocol without keys.

    Args:
        address: tcp://HOST:PORT, port 0 or * for any free one.
        insecure: Whether other machines may connect.
        protocol: Its name, for errors.

    Raises:
        EvsError: It has another form, or other machines could reach it and may not.
    """
    bound = bindable(address, True)
    if is_ipc(bound):
        raise EvsError(f"{protocol} needs an address of the form tcp://HOST:PORT, not '{address}'")
    host, _, port = bound.removeprefix("tcp://").rpartition(":")
    host = host.strip("[]")
    if not (_is_loopback(host) or insecure):
        raise EvsError(
            f"cannot serve {protocol} on '{address}': its protocol has no keys, whoever reaches "
            f"the port sees what the camera sees; use tcp://127.0.0.1:{port}, or insecure=true"
        )
    return host, int(port)


def connectable(address: str) -> str:
    """Return the address to connect to. Raises EvsError for another form or an unknown host."""
    if is_ipc(address):
        return _checked_path(address)
    host, port = _parts(address)
    if host == "*":
        raise EvsError(f"address '{address}' is every machine: give the one to connect to")
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
    """Return whether the host of tcp://HOST:PORT is an IPv6 number."""
    return address.startswith("tcp://[")


def is_ipc(address: str) -> bool:
    """Return whether it is a socket in the file system. Raises EvsError if it is no string."""
    if not isinstance(address, str):
        raise EvsError(f"an address is text, as in {DEFAULT_ADDRESS}, not {address!r}")
    return address.startswith(_IPC)


def check_unused(address: str) -> None:
    """Raise EvsError if an ipc address is a file, or in use by another program.

    ZeroMQ would replace either. A socket that a killed program left behind is free.
    """
    if not is_ipc(address):
        return
    path = Path(address.removeprefix(_IPC))
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise EvsError(f"'{path}' is a file: give another path")
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.connect(str(path))
    except (FileNotFoundError, ConnectionRefusedError):
        return
    except OSError as reason:
        raise EvsError(f"cannot bind '{address}': {reason.strerror}; give another path") from None
    raise EvsError(f"'{path}' is in use: end the program that serves there, or give another path")


def leave(address: str) -> None:
    """Remove the socket file of an ipc address, which ZeroMQ leaves behind."""
    if is_ipc(address):
        Path(address.removeprefix(_IPC)).unlink(missing_ok=True)


def _checked_path(address: str) -> str:
    path = Path(address.removeprefix(_IPC))
    if not path.is_absolute() or "\0" in address:
        raise EvsError(f"address '{address}' is not of the form ipc:///PATH, as in ipc:///tmp/evs")
    if len(str(path).encode()) > _LONGEST_PATH:
        raise EvsError(f"address '{address}' is too long: a path of {_LONGEST_PATH} bytes at most")
    if not path.parent.is_dir():
        raise EvsError(f"address '{address}': there is no folder '{path.parent}'")
    return f"{_IPC}{path}"


def _parts(address: str) -> tuple[str, str]:
    form = _FORM.fullmatch(address)
    if form is None:
        raise EvsError(
            f"address '{address}' is not of the form tcp://HOST:PORT, e.g. {DEFAULT_ADDRESS}, or "
            "ipc:///PATH"
        )
    host, port = form.group(1), form.group(2)
    # ZeroMQ would take 99999 for 34463
    if port != "*" and int(port) > 65535:
        raise EvsError(f"address '{address}' has port {port}: ports end at 65535")
    return host, port if port == "*" else str(int(port))


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def free_address() -> str:
    """Return tcp://127.0.0.1:PORT with a port that is free now.

    For a publisher and a subscriber that start together: a publisher that binds port 0 knows its
    port only once it is open, but the subscriber may connect before that.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.bind(("127.0.0.1", 0))
            return f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    except OSError as reason:
        raise EvsError(
            f"no free port on 127.0.0.1: {reason.strerror}; the loopback device must be up"
        ) from None
