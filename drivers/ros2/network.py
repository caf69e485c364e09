"""Which network interface DDS uses: the loopback one, unless others are meant to listen."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import EvsError, nearest_first

_FLAG_LOOPBACK = 0x8

MAX_DOMAIN_ID = 232
"""The ports of higher ones do not exist."""


@dataclass(frozen=True)
class Interface:
    """One interface, by name or address; by neither: the one that the middleware takes."""

    name: str = ""
    address: str = ""
    is_loopback: bool = False

    def __str__(self) -> str:
        return self.name or self.address or "any interface"


def interface_of(word: str, insecure: bool) -> Interface:
    """The interface that `word` names, or whose address it is; "": lo, insecure: any.

    EvsError: there is none of the name, or others would see it and nobody said that they may.
    """
    chosen = _found(word or ("" if insecure else "lo"))
    if not (chosen.is_loopback or insecure):
        raise EvsError(
            f"cannot publish for ROS 2 on {chosen}: DDS has no keys here, whoever is on that "
            "network sees what the camera sees; leave interface out, or set insecure=true"
        )
    return chosen


def checked_domain(number: int) -> int:
    """ROS_DOMAIN_ID's value. EvsError: out of its range."""
    if not 0 <= number <= MAX_DOMAIN_ID:
        raise EvsError(f"domain_id is {number}: give 0 ... {MAX_DOMAIN_ID}")
    return number


def _found(word: str) -> Interface:
    if not word:
        return Interface()
    try:
        address = ipaddress.ip_address(word)
    except ValueError:
        known = [name for _, name in socket.if_nameindex()]
        if word not in known:
            names = ", ".join(nearest_first(word, known))
            raise EvsError(f"no network interface '{word}' here; there is: {names}") from None
        return Interface(name=word, is_loopback=_is_loopback(word))
    return Interface(address=word, is_loopback=address.is_loopback)


def _is_loopback(name: str) -> bool:
    flags = Path("/sys/class/net", name, "flags")
    try:
        return bool(int(flags.read_text(), 16) & _FLAG_LOOPBACK)
    except OSError:
        return name == "lo"
