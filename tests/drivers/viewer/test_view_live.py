"""`evs view --live` in a terminal: a sketch in characters, and what its command line refuses."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from evs.drivers.bus import Publisher
from evs.drivers.bus.address import free_address
from evs.drivers.search_path import search_path
from evs.launch import main as program
from evs.msgs import EventPacket, StreamInfo, make_events

STREAM = StreamInfo(64, 48, camera="eye")


def packet(seq: int, camera: str = "eye") -> EventPacket:
    # a bar that goes to the right
    y = np.arange(48)
    t = np.full(48, 1000 * seq + 500)
    events = make_events(t, np.full(48, seq % 64), y, np.ones(48))
    return EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 64, 48, events, camera)


def publishing(address: str, streams: list[StreamInfo], ticks: int) -> threading.Thread:
    """Publish as in real time, in a thread."""

    def run() -> None:
        publisher = Publisher(address, wait_for=1, wait_s=30)
        publisher.open(streams)
        for seq in range(ticks):
            for stream in streams:
                publisher.write(packet(seq, stream.camera))
            time.sleep(0.001)
        publisher.close()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_sketches_one_below_the_other_where_no_terminal_is(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")
    address = free_address()
    thread = publishing(address, [STREAM], 200)
    code = program.main(["view", "--live", address, "--sketch", "--timeout", "20"])
    thread.join()
    said = capsys.readouterr()
    assert code == 0
    assert "packets 200  events 9600" in said.err
    assert "\x1b" not in said.out
    heads = re.findall(r"^eye  t ([\d.]+) s  48,000 events/s, 100 % ON  lost 0$", said.out, re.M)
    # no more than 20 a second, and each on the grid of 20 ms
    assert 1 <= len(heads) <= 11
    assert all(round(float(t) * 1000) % 20 == 0 for t in heads)
    # the bar fills the rows of the sketch: 48 px are 12 cells
    first = said.out.split("\n")[1:13]
    assert all(line.strip("\u2800") for line in first)


@pytest.mark.integration
def test_a_terminal_is_drawn_over_and_left_as_it_was() -> None:
    address = free_address()
    thread = publishing(address, [STREAM, StreamInfo(64, 48, camera="ear")], 300)
    ours, theirs = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": search_path(), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"COLUMNS": "70", "LINES": "30", "PYTHONUTF8": "1"}
    words = ["view", "--live", address, "--sketch", "--timeout", "20"]
    process = subprocess.Popen(
        [sys.executable, "-m", "evs.launch.main", *words],
        stdout=theirs,
        stderr=subprocess.PIPE,
        env=environment,
    )
    os.close(theirs)
    data = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other end has gone
            break
        if not part:
            break
        data += part
    os.close(ours)
    thread.join()
    assert process.stderr is not None
    assert b"packets 600  events 28800" in process.stderr.read()
    process.stderr.close()
    assert process.wait(20) == 0
    text = data.decode()
    assert text.startswith("\x1b[?1049h\x1b[?25l")
    assert text.rstrip().endswith("\x1b[?25h\x1b[?1049l")
    assert "\x1b[38;2;0;114;255m" in text
    assert "eye  t " in text
    assert "ear  t " in text
    # the second camera has its place below the first
    assert "\x1b[16;1Hear" in text or "\x1b[16;1Heye" in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give a recording, as in evs view run.aedat4, or --live ADDRESS"),
        (["a.npz", "--live", "tcp://127.0.0.1:9"], "or --live ADDRESS"),
        (["--live", "tcp://127.0.0.1:9", "--fps", "3"], "--fps is for recordings"),
        (["a.npz", "--sketch"], "belong to --live"),
        (["--live", "tcp://127.0.0.1:9", "-o", "a.png"], "end it in .rrd"),
        (["a.npz", "--rerun-web"], "belong to --live"),
        (["a.npz", "--points", "9"], "belong to --live"),
        (["--live", "tcp://127.0.0.1:9", "-o", "a.rrd", "--sketch"], "-o and --sketch show"),
        (["--live", "tcp://127.0.0.1:9", "--rerun-web", "--sketch"], "in different places"),
        (["--live", "tcp://127.0.0.1:9", "--sketch", "--points", "9"], "--points draws in Rerun"),
        (["--live", "nonsense", "--sketch"], "not of the form tcp://HOST:PORT"),
        (["--live", "tcp://127.0.0.1:9", "--sketch", "--timeout", "0.1"], "nothing came from"),
    ],
)
def test_what_is_not_possible_is_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert program.main(["view", *words]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
