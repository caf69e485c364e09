"""Addresses of lock-step: those of the bus, and ipc:///PATH between programs of one machine."""

from __future__ import annotations

from pathlib import Path

from evs.drivers.bus import address as bus
from evs.drivers.bus.exchange import IPC
from evs.msgs import EvsError

_LONGEST = 107
"""bytes of a path that a socket of the file system may have"""


def bindable(address: str, open_to_others: bool = False) -> str:
    """The address to bind. EvsError for another form, and for what others could reach unasked."""
    if address.startswith(IPC):
        return _checked(address)
    return bus.bindable(address, open_to_others, does="serve a closed loop")


def connectable(address: str) -> str:
    """The address to connect to. EvsError for another form or host."""
    return _checked(address) if address.startswith(IPC) else bus.connectable(address)


def _checked(address: str) -> str:
    path = Path(address.removeprefix(IPC))
    if not path.is_absolute() or "\0" in address:
        raise EvsError(f"address '{address}' is not of the form ipc:///PATH, as in ipc:///tmp/loop")
    if len(str(path).encode()) > _LONGEST:
        raise EvsError(f"address '{address}' is too long: a path of {_LONGEST} bytes at most")
    if not path.parent.is_dir():
        raise EvsError(f"address '{address}': there is no folder '{path.parent}'")
    return address
