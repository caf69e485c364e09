"""What tests of the bus share."""

from __future__ import annotations

import pytest

from evs.drivers.bus.address import free_address


@pytest.fixture
def address() -> str:
    """An address whose port nobody uses."""
    return free_address()
