"""The cable of the other tests: it carries, can be pulled and put in again, and leaves nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.clock import monotonic_s, sleep_s
from links.link import Link

pytestmark = pytest.mark.integration

CALLER = """
import socket, sys
with socket.create_connection((sys.argv[1], 7777), 5) as line:
    print(line.recv(9).decode())
"""
ANSWERER = """
import socket, sys
family = socket.AF_INET6 if ":" in sys.argv[1] else socket.AF_INET
with socket.create_server((sys.argv[1], 7777), family=family) as server:
    print("ready", flush=True)
    while True:
        line, _ = server.accept()
        with line:
            line.sendall(b"well met")
"""


def call(link: Link, address: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", CALLER, address]
    return link.far.run(command, stdout=pipe, stderr=subprocess.DEVNULL, text=True)


@pytest.mark.parametrize("version", [4, 6])
def test_a_cable_carries_until_it_is_pulled_and_again_after(link: Link, version: int) -> None:
    if version == 6 and not link.near.has_ipv6:
        pytest.skip("this machine has no IPv6")
    address = link.near.address if version == 4 else link.near.address6
    command = [sys.executable, "-c", ANSWERER, address]
    answerer = link.near.run(command, stdout=subprocess.PIPE, text=True)
    assert answerer.stdout.readline() == "ready\n"
    assert call(link, address).communicate(timeout=30)[0] == "well met\n"
    link.unplug()
    cut_off = call(link, address)
    assert cut_off.communicate(timeout=30)[0] == ""
    assert cut_off.returncode == 1
    link.plug()
    assert call(link, address).communicate(timeout=30)[0] == "well met\n"


def test_the_ends_see_each_other_and_nobody_else(link: Link) -> None:
    cards = set()
    for side in (link.near, link.far):
        one = side.run(["ip", "-o", "link"], stdout=subprocess.PIPE, text=True)
        out, _ = one.communicate(timeout=30)
        cards |= {line.split(":")[1].split("@")[0].strip() for line in out.splitlines()}
    # some kernels put idle tunnels into every namespace
    assert {"lo", "evs0"} <= cards
    assert not any(name.startswith(("eth", "en", "wl")) for name in cards)


def test_nothing_stays_behind_when_the_test_is_killed(link: Link) -> None:
    """Not even after kill -9: the namespaces go with the process that held them."""
    script = (
        "import sys, time; from links.link import Link; one = Link();"
        "print(one.near.pid, one.far.pid, flush=True); time.sleep(60)"
    )
    folder = str(Path(__file__).parents[1] / "support")
    tester = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": folder},
    )
    assert tester.stdout is not None
    held = [int(word) for word in tester.stdout.readline().split()]
    assert len(held) == 2
    tester.send_signal(signal.SIGKILL)
    tester.communicate()
    deadline_s = monotonic_s() + 30
    while any(_is_there(pid) for pid in held) and monotonic_s() < deadline_s:
        sleep_s(0.02)
    assert not any(_is_there(pid) for pid in held)


def _is_there(pid: int) -> bool:
    """Running: a zombie whom nobody waits for is gone."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False
