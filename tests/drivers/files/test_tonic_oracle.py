"""AEDAT2, AEDAT3.1 and CSV as other projects read them: tonic, faery, numpy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.recording_file import by_tick
from evs.msgs import EventPacket, Events, StreamInfo, make_events
from reference.oracles import ORACLES_PYTHON, OracleProgram
from reference.streams import random_events

SCRIPT = Path(__file__).parents[2] / "support" / "oracles" / "tonic_oracle.py"
tonic = OracleProgram(SCRIPT, ORACLES_PYTHON)

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, config={"a": "# \n"})
COUNT = 120_000


def seen(begin_us: int, end_us: int, count: int = COUNT) -> Events:
    # the first one is in row 0: tonic takes a first byte of '#' for one more line of header
    return random_events(count, begin_us - 1, end_us - 1)


SPANS = {
    "plain": (1, 3_000_000),
    "2^24": ((1 << 24) - 500_000, (1 << 24) + 500_000),
    "2^31": ((1 << 31) - 500_000, (1 << 31) + 500_000),
    "2^32": ((1 << 32) - 500_000, (1 << 32) + 500_000),
}


def digest(t: Any, events: Events) -> str:
    """Tonic's digest of these events at other times."""
    return tonic.digest(make_events(t, events["x"], events["y"], events["p"]))


def record(path: Path, events: Events, at_once: bool = False) -> None:
    sink = files.recorder_for(path)
    sink.open([STREAM])
    parts = [events] if at_once else by_tick(events, STREAM)
    for seq, part in enumerate(parts):
        sink.write(EventPacket(seq, 0, 0, 346, 260, part, "eye"))
    sink.close()


def test_tonic_reads_aedat2_bit_exactly(tmp_path: Path) -> None:
    wanted = []
    for name, (begin_us, end_us) in SPANS.items():
        events = seen(begin_us, end_us)
        path = tmp_path / f"{name}.aedat"
        record(path, events)
        # each file of a recording that wraps begins again at 0
        parts = np.split(events, np.flatnonzero(np.diff(events["t"] >> 31)) + 1)
        paths = [path, tmp_path / f"{name}-001.aedat"][: len(parts)]
        for part_path, part in zip(paths, parts, strict=True):
            wanted.append((part_path, len(part), digest(part["t"] & ((1 << 31) - 1), part)))
            assert files.read(part_path, single=True).tobytes() == part.tobytes()
    assert len(wanted) == 6
    told = tonic(*(path for path, _, _ in wanted))
    assert [(said["events"], said["digest"]) for said in told] == [each[1:] for each in wanted]
    assert {said["version"] for said in told} == {2.0}


@pytest.mark.integration
def test_tonic_reads_aedat3_bit_exactly(tmp_path: Path) -> None:
    wanted = []
    cases = {name: (seen(*span), False) for name, span in SPANS.items()}
    cases["at_once"] = seen((1 << 31) - 50, (1 << 31) + 50, 65_535), True
    cases["one"] = seen(5, 9, 2)[:1], False
    for name, (events, at_once) in cases.items():
        path = tmp_path / f"{name}.aedat3"
        record(path, events, at_once)
        # tonic does not look at the overflow counter
        wanted.append((path, len(events), digest(events["t"] & ((1 << 31) - 1), events)))
        assert files.read(path).tobytes() == events.tobytes()
    told = tonic(*(path for path, _, _ in wanted))
    assert [(said["events"], said["digest"]) for said in told] == [each[1:] for each in wanted]
    assert {said["version"] for said in told} == {3.1}


@pytest.mark.parametrize("span", SPANS)
def test_numpy_reads_csv_bit_exactly(tmp_path: Path, span: str) -> None:
    events = seen(*SPANS[span])
    path = tmp_path / "a.csv"
    record(path, events)
    table = np.loadtxt(path, np.int64, delimiter=",", skiprows=1)
    assert np.array_equal(table, np.stack([events[name] for name in "txyp"], axis=1))
    assert files.read(path).tobytes() == events.tobytes()


def test_faerys_csv_is_read(tmp_path: Path) -> None:
    events = seen(1, 2_000_000)
    np.save(tmp_path / "a.npy", np.stack([events[name] for name in "txyp"], axis=1))
    code = (
        "import sys, numpy as np, faery\n"
        "given = np.load(sys.argv[1])\n"
        "every = np.zeros(len(given), faery.EVENTS_DTYPE)\n"
        "for k, name in enumerate(('t', 'x', 'y', 'on')):\n"
        "    every[name] = given[:, k]\n"
        "stream = faery.events_stream_from_array(every, dimensions=(346, 260))\n"
        "stream.to_file(sys.argv[2])\n"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "a.npy"), str(tmp_path / "a.csv")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    read = files.read(tmp_path / "a.csv")
    assert read.tobytes() == events.tobytes()
    assert (read.stream.width, read.stream.height) == (346, 260)
