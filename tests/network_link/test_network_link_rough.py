"""The bus over a bad line: packets late, out of order, lost on the way; none is lost for good."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.bus.curve_keys import write_keys
from links.camera import Camera
from links.link import Link, NoLinkError

pytestmark = pytest.mark.integration

LISTENER = """
import json, sys
from evs.drivers.bus import Latest, discover, subscribe
where, key = sys.argv[1], sys.argv[2]
here = discover(where, timeout_s=30, server_key=key)
first, seqs = None, []
with subscribe(here.address, timeout_s=60, server_key=key) as stream:
    with Latest(here.latest, server_key=key) as latest:
        for packet in stream:
            seqs.append(packet.seq)
            assert int(packet.events["t"][0]) == packet.time_base_us + 1
        assert latest.get(0) is not None
    print(json.dumps({**stream.totals(), "first": seqs[0], "in_order": seqs == sorted(seqs)}))
"""


def totals(listener: subprocess.Popen[str]) -> dict[str, Any]:
    out, _ = listener.communicate(timeout=120)
    assert listener.returncode == 0
    said: dict[str, Any] = json.loads(out)
    return said


@pytest.mark.parametrize(
    ("events", "is_too_much"),
    [
        pytest.param(30, False, id="fits"),
        pytest.param(3000, True, id="too much", marks=pytest.mark.slow),
    ],
)
def test_a_bad_line(link: Link, tmp_path: Path, events: int, is_too_much: bool) -> None:
    try:
        near, _ = link.add_rough_line(delay_ms=15, jitter_ms=5, loss=0.02)
    except NoLinkError as reason:
        pytest.skip(f"no TUN device here: {reason}")
    key, secret = (str(one) for one in write_keys(tmp_path / "camera"))
    here = f"tcp://{near}:0"
    camera = Camera(
        link.near, "bus", events=events, address=here, control=here, key=secret, linger_s=30
    )
    command = [sys.executable, "-W", "error", "-c", LISTENER, camera.where["control"], key]
    listener = link.far.run(command, stdout=-1, text=True)
    camera.wait("here", 1)
    camera.wait("seq", camera.look()["seq"] + 4000)
    report = camera.stop()
    heard = totals(listener)
    assert heard["first"] + heard["packets"] + heard["lost"] == report["seq"]
    assert heard["in_order"]
    assert (heard["ended"], heard["bad_messages"], heard["restarts"]) == (True, 0, 0)
    # 0.5 MB/s pass such a line, 48 MB/s do not: then the queue loses the newest, counted
    assert (heard["lost"] > 0) is is_too_much
    assert heard["packets"] > 0
    assert report["slowest_s"] < 1.0
