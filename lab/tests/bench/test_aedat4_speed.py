"""AEDAT4 encoders, processor time for packets of 1 ms: ours beside faery's and dv-processing's.

Peers are programs of their own: faery (LGPL) in a venv of its own under build/. Memory holds the
file (a tmpfs where there is one), so that no disk is timed. All encode the same packets in turns.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import EventPacket, Events, StreamInfo, make_events
from speed import aedat4_peer
from speed.aedat4_peer import SIZE, TICK_US
from speed.elsewhere import AbsentError
from speed.turns import Table, Time, spread, target
from speed.venvs import python_with

CHECKOUT = Path(__file__).parents[3]
PEER = Path(aedat4_peer.__file__)
COMPRESSIONS = ("none", "lz4", "zstd")
EVENTS, TICKS, ROUNDS = 1000, 300, 7
AT_LEAST = {"none": 15.0, "lz4": 5.0, "zstd": 2.5}
"""times dv-processing's Python path, as the issue asks"""

Encode = Callable[[str], float]
"""compression -> seconds of processor time"""


def random_events() -> Events:
    """Random positions: the worst that a compression can meet."""
    random = np.random.default_rng(1)
    t = np.sort(random.integers(1, TICKS * TICK_US + 1, EVENTS * TICKS))
    columns = (random.integers(0, side, len(t)) for side in (*SIZE, 2))
    return make_events(t, *columns)


def edge_events() -> Events:
    """An edge that moves over the sensor: neighbours in time are neighbours in place."""
    random = np.random.default_rng(2)
    t = np.sort(random.integers(1, TICKS * TICK_US + 1, EVENTS * TICKS))
    y = random.integers(0, SIZE[1], len(t))
    x = (t // 300 + y // 8 + random.integers(0, 2, len(t))) % SIZE[0]
    return make_events(t, x, y, np.ones(len(t)))


def ours(events: Events, path: Path) -> tuple[Encode, Callable[[], int]]:
    """Our recorder, and the size of what it wrote last."""
    cuts = np.flatnonzero(np.diff(-(-events["t"] // TICK_US))) + 1
    packets = [
        EventPacket(seq, TICK_US * seq, TICK_US * (seq + 1), *SIZE, part)
        for seq, part in enumerate(np.split(events, cuts))
    ]

    def encode(compression: str) -> float:
        begin = time.process_time()
        recorder = Aedat4Recorder(path, compression)
        recorder.open([StreamInfo(*SIZE)])
        for packet in packets:
            recorder.write(packet)
        recorder.close()
        return time.process_time() - begin

    return encode, lambda: path.stat().st_size


@contextmanager
def peer(python: Path | str, name: str, events: Path, path: Path) -> Iterator[Encode]:
    """Another project's encoder."""
    process = subprocess.Popen(
        [str(python), str(PEER), name, str(events), str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    reads, writes = process.stdout, process.stdin

    def said(word: str) -> str:
        # libraries print lines of their own
        for line in reads:
            if line.startswith(word):
                return line.removeprefix(word).strip()
        raise AssertionError(f"{name} ended before it said {word}")

    def encode(compression: str) -> float:
        writes.write(f"{compression}\n")
        writes.flush()
        return float(said("answer"))

    try:
        said("ready")
        yield encode
    finally:
        writes.close()
        reads.close()
        process.wait(30)


@pytest.mark.bench
def test_aedat4_encoders() -> None:
    memory = Path("/dev/shm")
    place = memory if memory.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as name, ExitStack() as stack:
        folder = Path(name)
        for what, events in (("random", random_events()), ("an edge", edge_events())):
            given = folder / f"{what}.npy"
            np.save(given, events)
            encode, size = ours(events, folder / "ours.aedat4")
            encoders = {"evs": encode}
            dv = peer(sys.executable, "dv-processing", given, folder / "dv.aedat4")
            encoders["dv-processing"] = stack.enter_context(dv)
            try:
                python = python_with(CHECKOUT, "faery", "numpy")
            except AbsentError as absent:
                print(f"\n{absent}")
            else:
                other = peer(python, "faery", given, folder / "faery.aedat4")
                encoders["faery"] = stack.enter_context(other)
            compare(what, len(events), encoders, size, folder / "faery.aedat4")


def compare(
    what: str, count: int, encoders: dict[str, Encode], size: Callable[[], int], other: Path
) -> None:
    """The table and the targets of one kind of events."""
    columns: dict[str, dict[str, Time]] = {}
    sizes = []
    for compression in COMPRESSIONS:
        samples: dict[str, list[float]] = {name: [] for name in encoders}
        for _ in range(ROUNDS + 1):
            for name, encode in encoders.items():
                samples[name].append(1e3 * encode(compression))
        columns[compression] = {name: spread(taken[1:]) for name, taken in samples.items()}
        theirs = f", faery's {other.stat().st_size / count:.1f}" if other.exists() else ""
        sizes.append(f"{compression} {size() / count:.1f}{theirs}")
    yardsticks = dict.fromkeys(["evs", *encoders], "dv-processing")
    del yardsticks["dv-processing"]
    print(Table(f"AEDAT4, {count} events ({what}) in packets of 1 ms", columns, yardsticks))
    print("bytes an event:", "; ".join(sizes))
    for compression, times in columns.items():
        mine = times["evs"].median
        rate = count / mine / 1e3
        print(f"evs, {compression}: {rate:.1f} Mev per second of processor time")
        dv_times = times["dv-processing"].median / mine
        print(target(f"{compression}, beside dv-processing", dv_times, AT_LEAST[compression], "x"))
        if "faery" in times:
            print(target(f"{compression}, beside faery", times["faery"].median / mine, 0.9, "x"))
        assert mine > 0
