"""The DV server over a cable that is pulled: one client's link is nobody else's matter."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from evs.drivers.clock import monotonic_s
from links.camera import Camera
from links.link import Link, Side

pytestmark = pytest.mark.integration

CLIENT = """
import json, socket, sys
from evs.drivers.files.aedat4 import layout
link = socket.create_connection((sys.argv[1], int(sys.argv[2])), 10)
link.settimeout(float(sys.argv[3]))
stream = link.makefile("rb")
size = stream.read(4)
layout.parse_io_header(size + stream.read(int.from_bytes(size, "little")))
seqs, why = [], "hung up on"
try:
    while head := stream.read(8):
        body = stream.read(layout.PACKET_HEADER.unpack(head)[1])
        seqs.append((int(layout.parse_events(body)["t"][0]) - 1) // 1000)
except TimeoutError:
    why = "nothing came"
print(json.dumps({"seqs": seqs, "why": why}))
"""
QUEUE = 200
"""packets of 48 kB"""
EVENTS = 3000
SLOWEST_S = 1.0


def connect(side: Side, camera: Camera, host: str, timeout_s: float) -> subprocess.Popen[str]:
    port = str(camera.where["cam/events"])
    command = [sys.executable, "-W", "error", "-c", CLIENT, host, port, str(timeout_s)]
    return side.run(command, stdout=-1, text=True)


def said(client: subprocess.Popen[str]) -> dict[str, Any]:
    out, _ = client.communicate(timeout=60)
    assert client.returncode == 0
    found: dict[str, Any] = json.loads(out)
    return found


def serve(link: Link, **options: Any) -> Camera:
    """On every address of the near end: one client is there, too."""
    address = "tcp://0.0.0.0:0"
    return Camera(
        link.near, "dv", events=EVENTS, address=address, insecure=True, queue=QUEUE, **options
    )


def test_a_clients_cable_is_out_for_seconds(link: Link) -> None:
    camera = serve(link)
    beside = connect(link.near, camera, "127.0.0.1", 60)
    far = connect(link.far, camera, link.near.address, 60)
    camera.wait("here", 2)
    begin = camera.look()
    camera.wait("seq", begin["seq"] + 300)
    link.unplug()
    out_at = camera.look()["seq"]
    camera.wait("seq", out_at + 1500)
    # a queue of 200, and as much for what the allocator keeps; five times as much was sent
    grown_kb = camera.look()["memory_kb"] - begin["memory_kb"]
    assert grown_kb < 2 * QUEUE * 16 * EVENTS / 1024
    link.plug()
    in_at = camera.look()["seq"]
    camera.wait("seq", in_at + 3000)
    report = camera.stop()
    assert report["slowest_s"] < SLOWEST_S
    well, cut = said(beside), said(far)
    assert well["seqs"] == list(range(well["seqs"][0], report["seq"]))
    # whole packets in order; a hole of the oldest; the newest again
    assert cut["seqs"] == sorted(set(cut["seqs"]))
    assert cut["seqs"][-1] == report["seq"] - 1
    lost = report["seq"] - cut["seqs"][0] - len(cut["seqs"])
    assert lost > 0
    assert (report["packets_dropped"], report["events_dropped"]) == (lost, lost * EVENTS)
    assert (well["why"], cut["why"]) == ("hung up on", "hung up on")


@pytest.mark.parametrize("sends", [True, False])
def test_a_client_whose_cable_is_out_for_good_is_given_up(link: Link, sends: bool) -> None:
    """Whether something is under way to it or not: the system asks, and nobody answers."""
    if not sends:
        # a stream that is silent: of a camera that sees nothing
        camera = Camera(
            link.near,
            "dv",
            events=0,
            address="tcp://0.0.0.0:0",
            insecure=True,
            patience_s=3,
            linger_s=60,
        )
    else:
        camera = serve(link, patience_s=3, linger_s=60)
    far = connect(link.far, camera, link.near.address, 2)
    camera.wait("here", 1)
    link.unplug()
    begin_s = monotonic_s()
    camera.wait("here", 0, 0, patience_s=60)
    # not at once: a cable that is put back in time costs nobody his connection
    assert monotonic_s() - begin_s > 2
    report = camera.stop()
    assert report["slowest_s"] < SLOWEST_S
    assert said(far)["why"] == "nothing came"
    # nobody was there to wait for, a minute long
    assert report["closing_s"] < 20
