"""The clients that stand in the pages count right: in C++, and in another Python."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.bus import Publisher
from evs.drivers.bus.address import free_address
from evs.msgs import EventPacket, StreamInfo, make_events
from reference.cpp_client import build, program_of

pytestmark = pytest.mark.integration

LINES = 40
DOCS = Path(__file__).parents[3] / "docs"
PAGE = DOCS / "reference/wire.md"


def test_the_page_holds_a_short_program() -> None:
    program = program_of(PAGE)
    assert len([line for line in program.splitlines() if line]) <= LINES


def test_a_client_in_another_language_counts_every_event(tmp_path: Path) -> None:
    check_count([str(build(PAGE, tmp_path))])


@pytest.mark.parametrize("python", [sys.executable, "python3.10"])
def test_a_client_in_another_python_counts_every_event(python: str, tmp_path: Path) -> None:
    needs = [python, "-c", "import zmq, msgpack, numpy"]
    if shutil.which(python) is None or subprocess.run(needs, capture_output=True).returncode:
        pytest.skip(f"no {python} with pyzmq, msgpack and numpy")
    (program,) = re.findall(
        r"^```python\n(.*?)^```", (DOCS / "howto/install.md").read_text(), re.DOTALL | re.MULTILINE
    )
    client = tmp_path / "client.py"
    client.write_text(program)
    check_count([python, str(client)])


def check_count(client: list[str]) -> None:
    """A client of a publisher that drops packets prints how many events came and what it lost."""
    random = np.random.default_rng(0)
    events = on = 0
    address = free_address()
    sender = Publisher(address, wait_for=1, wait_s=60)
    with subprocess.Popen([*client, address], stdout=subprocess.PIPE, text=True) as process:
        sender.open([StreamInfo(346, 260, "cam")])
        # seq as msgpack's one, two, three and five bytes, and packets that a full queue dropped
        seqs = [0, 1, 126, 127, 128, 255, 256, 65_535, 65_536, 70_000]
        for seq in seqs:
            size = int(random.integers(0, 5000))
            t = np.sort(random.integers(1000 * seq + 1, 1000 * seq + 1001, size))
            p = random.integers(0, 2, size)
            body = make_events(t, t % 346, t % 260, p)
            sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, body, "cam"))
            events, on = events + size, on + int(p.sum())
        sender.close()
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    lost = seqs[-1] + 1 - len(seqs)
    assert out == f"events {events}, ON {on}, lost {lost}\n"
