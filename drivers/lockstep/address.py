"""Addresses of lock-step: those of the bus."""

from __future__ import annotations

from evs.drivers.bus import address as bus


def bindable(address: str, open_to_others: bool = False) -> str:
    """The address to bind. EvsError for another form, and for what others could reach unasked."""
    return bus.bindable(address, open_to_others, does="serve a closed loop")


def connectable(address: str) -> str:
    """The address to connect to. EvsError for another form or host."""
    return bus.connectable(address)
