"""Addresses: one form, this machine only for a publisher, and an error that says the fix."""

import pytest

from evs.drivers.bus.address import bindable, connectable, is_ipv6
from evs.msgs import DEFAULT_ADDRESS, EvsError


@pytest.mark.parametrize(
    ("address", "bound"),
    [
        (DEFAULT_ADDRESS, "tcp://127.0.0.1:5560"),
        ("tcp://localhost:05560", "tcp://127.0.0.1:5560"),
        ("tcp://127.0.0.1:0", "tcp://127.0.0.1:0"),
        ("tcp://127.0.0.1:*", "tcp://127.0.0.1:0"),
        ("tcp://127.8.9.10:65535", "tcp://127.8.9.10:65535"),
        ("tcp://[::1]:5560", "tcp://[::1]:5560"),
    ],
)
def test_this_machines_own_can_be_bound(address: str, bound: str) -> None:
    assert bindable(address) == bound


@pytest.mark.parametrize(
    "address",
    [
        "tcp://0.0.0.0:5560",
        "tcp://*:5560",
        "tcp://192.168.1.5:5560",
        "tcp://[::]:5560",
        "tcp://eth0:5560",
        "tcp://robot.example:5560",
    ],
)
def test_what_others_could_reach_is_refused(address: str) -> None:
    with pytest.raises(EvsError, match=r"use tcp://127\.0\.0\.1:5560.*ssh -L") as caught:
        bindable(address)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "address",
    [
        "",
        "5560",
        "127.0.0.1:5560",
        "tcp:127.0.0.1:5560",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:",
        "tcp://127.0.0.1:port",
        "tcp://127.0.0.1:-1",
        "tcp://127.0.0.1:99999",
        "tcp://127.0.0.1:5560/",
        "tcp://127.0.0.1:5560 ",
        "tcp://127.0.0.1:5560\n",
        "tcp://::1:5560",
        "tcp://:5560",
        "ipc:///tmp/bus",
        "inproc://bus",
        "udp://127.0.0.1:5560",
        "tcp://127.0.0.1:٣",
    ],
)
def test_other_forms_are_refused_at_both_ends(address: str) -> None:
    for check in (bindable, connectable):
        with pytest.raises(EvsError, match="address"):
            check(address)


def test_connecting_needs_a_port_and_a_machine() -> None:
    assert connectable("tcp://localhost:5560") == "tcp://localhost:5560"
    assert connectable("tcp://10.1.2.3:5560") == "tcp://10.1.2.3:5560"
    for port in ("0", "*"):
        with pytest.raises(EvsError, match="no port to connect to"):
            connectable(f"tcp://127.0.0.1:{port}")
    # a label of 64 letters can be no machine's name, so nobody is asked
    with pytest.raises(EvsError, match="no machine"):
        connectable(f"tcp://{'a' * 64}:5560")


def test_ipv6_is_known_by_its_brackets() -> None:
    assert is_ipv6("tcp://[::1]:5560")
    assert not is_ipv6(DEFAULT_ADDRESS)
