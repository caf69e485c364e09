"""Addresses: one form, this machine only for a publisher, and an error that says the fix."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest

from evs.drivers.bus import Described, Publisher, discover, subscribe
from evs.drivers.bus.address import bindable, connectable, is_ipv6
from evs.drivers.dv import DvServer
from evs.msgs import DEFAULT_ADDRESS, EventPacket, EvsError, StreamInfo, make_events


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
        "ipc://",
        "ipc://bus",
        "ipc://@bus",
        "ipc:///no/such/folder/bus",
        f"ipc:///tmp/{'b' * 110}",
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
    with pytest.raises(EvsError, match="every machine"):
        connectable("tcp://*:5560")
    with pytest.raises(EvsError, match="is text, as in tcp"):
        connectable(None)  # type: ignore[arg-type]
    # a label of 64 letters can be no machine's name, so nobody is asked
    with pytest.raises(EvsError, match="no machine"):
        connectable(f"tcp://{'a' * 64}:5560")


def test_ipv6_is_known_by_its_brackets() -> None:
    assert is_ipv6("tcp://[::1]:5560")
    assert not is_ipv6(DEFAULT_ADDRESS)


def test_a_socket_in_the_file_system_is_an_address(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/bus"
    assert bindable(address) == connectable(address) == address
    assert not is_ipv6(address)
    control = f"ipc://{tmp_path}/control"
    sender = Publisher(address, wait_for=1, control=control, linger_s=5)
    events = make_events([1, 2], [3, 4], [5, 6], [0, 1])
    # the subscriber may come first, as with tcp
    with subscribe(address, timeout_s=20) as stream:
        sender.open([StreamInfo(32, 24, "cam")])
        sender.write(EventPacket(0, 0, 1000, 32, 24, events, "cam"))
        answers: list[Described] = []
        asking = threading.Thread(target=lambda: answers.append(discover(control, timeout_s=20)))
        asking.start()
        while asking.is_alive():
            sender.wants_pose("cam")
        assert (answers[0].address, answers[0].latest) == (address, f"{control}.latest")
        closing = threading.Thread(target=sender.close)
        closing.start()
        assert [packet.events.tobytes() for packet in stream] == [events.tobytes()]
        closing.join(20)
    assert list(tmp_path.iterdir()) == []


def test_what_stands_at_a_path_is_not_taken_away(tmp_path: Path) -> None:
    file, used = tmp_path / "notes.txt", f"ipc://{tmp_path}/bus"
    file.write_text("mine")
    with pytest.raises(EvsError, match=r"notes.txt' is a file: give another path"):
        Publisher(f"ipc://{file}").open([StreamInfo(32, 24)])
    assert file.read_text() == "mine"
    first = Publisher(used)
    first.open([StreamInfo(32, 24)])
    with pytest.raises(EvsError, match=r"bus' is in use: end the program that serves there"):
        Publisher(used).open([StreamInfo(32, 24)])
    first.close()
    # what a killed program left behind is free
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(tmp_path / "bus"))
    second = Publisher(used)
    second.open([StreamInfo(32, 24)])
    second.close()


def test_dv_has_ports_only(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="DV needs an address of the form tcp://HOST:PORT"):
        DvServer(f"ipc://{tmp_path}/dv")
