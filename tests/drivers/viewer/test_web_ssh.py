"""The page reaches a desk through a real ssh tunnel, on another port than it is served on."""

from __future__ import annotations

import getpass
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest
from websockets.sync.client import connect

from evs.drivers.bus.address import free_address
from tests.drivers.viewer.test_web_page import Served, next_of, packet

Tunnel = Callable[[int], int]
"""opens a port that leads to another one"""

SSHD = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin") or ""
pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(not SSHD, reason="no sshd (Debian: apt install openssh-server)"),
]


def free_port() -> int:
    return int(free_address().rpartition(":")[2])


def key(path: Path) -> Path:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", path], check=True)
    return path


@pytest.fixture
def tunnel_to(tmp_path: Path) -> Iterator[Tunnel]:
    """Forwards a port of its own to one on the other side, whose sshd is ours alone."""
    host, own, port = key(tmp_path / "host"), key(tmp_path / "own"), free_port()
    shutil.copy(own.with_suffix(".pub"), tmp_path / "authorized")
    # where Debian's sshd gives up its rights
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)
    settings = {
        "ListenAddress": f"127.0.0.1:{port}",
        "HostKey": host,
        "AuthorizedKeysFile": tmp_path / "authorized",
        "PidFile": "none",
        "StrictModes": "no",
        "UsePAM": "no",
    }
    words = [word for name, value in settings.items() for word in ("-o", f"{name}={value}")]
    server = subprocess.Popen([SSHD, "-D", "-e", "-f", "/dev/null", *words], stderr=subprocess.PIPE)
    clients: list[subprocess.Popen[bytes]] = []

    def forward(target: int) -> int:
        near = free_port()
        options = ["StrictHostKeyChecking=no", "UserKnownHostsFile=/dev/null", "BatchMode=yes"]
        options += ["ExitOnForwardFailure=yes", "ConnectionAttempts=20", "LogLevel=ERROR"]
        words = [word for option in options for word in ("-o", option)]
        forwarded = f"127.0.0.1:{near}:127.0.0.1:{target}"
        address = ["-p", str(port), "-i", str(own), f"{getpass.getuser()}@127.0.0.1"]
        clients.append(
            subprocess.Popen(["ssh", "-F", "none", "-N", *words, "-L", forwarded, *address])
        )
        return near

    yield forward
    for one in (*clients, server):
        one.terminate()
        one.communicate()


def test_the_page_passes_a_tunnel(tmp_path: Path, tunnel_to: Tunnel) -> None:
    with closing(Served(tmp_path)) as served:
        port = tunnel_to(served.port)
        address = f"127.0.0.1:{port}"
        until_s = time.monotonic() + 20
        while True:
            try:
                page = connect(
                    f"ws://{address}/ws?token={served.token}", origin=f"http://{address}"
                )
                break
            except OSError:
                assert time.monotonic() < until_s
                time.sleep(0.1)
        with page:
            for seq in range(20):
                served.send(packet(seq))
            header, events, _ = next_of(page, bytes)
            assert header["events"] == len(events) > 0
