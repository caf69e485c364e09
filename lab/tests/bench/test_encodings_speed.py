"""Our encodings beside faery's EVT3 encoder (Rust), in packets of 1 ms and large.

faery, which has another licence, runs in a process of its own and times itself, in the same turn.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.msgs import Events, make_events
from evs.msgs.codecs import (
    PayloadReader,
    PayloadWriter,
    decode_dat,
    decode_evt2,
    decode_evt3,
    decode_evt21,
    encode_dat,
    encode_evt2,
    encode_evt3,
    encode_evt21,
)
from speed.turns import Time, spread, target

COUNT = 1_000_000
ROUNDS = 9
SIZES = {"1,000 events a packet": 1000, "10,000": 10_000, "all in one": COUNT}
TARGET_MEV = 20.0

FAERY = """
import json, sys, time
import faery, numpy as np
from pathlib import Path
events = np.load(sys.argv[1])
size, rounds, path = int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[1]).with_suffix(".raw")
found = {"write": [], "read": []}
for _ in range(rounds):
    begin = time.process_time()
    with faery.evt.Encoder(path, "evt3", False, (1280, 720), True) as encoder:
        for start in range(0, len(events), size):
            encoder.write({"events": events[start : start + size]})
    found["write"].append(1e3 * (time.process_time() - begin))
    begin = time.process_time()
    with faery.evt.Decoder(path, None, None) as decoder:
        for packet in decoder:
            pass
    found["read"].append(1e3 * (time.process_time() - begin))
print(json.dumps(found))
"""


def stream() -> Events:
    random = np.random.default_rng(1)
    t = np.sort(random.integers(0, 200_000, COUNT))
    x, y = random.integers(0, 1280, COUNT), random.integers(0, 720, COUNT)
    return make_events(t, x, y, random.integers(0, 2, COUNT))


def times(call: Callable[[], object]) -> Time:
    """CPU ms of one call: what runs beside it does not count."""
    import time

    samples = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        call()
        samples.append(1e3 * (time.process_time() - begin))
    return spread(samples)


@pytest.mark.bench
def test_encodings_are_fast(tmp_path: Path) -> None:
    events = stream()
    file = tmp_path / "events.npy"
    plain = np.zeros(COUNT, [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
    for ours, theirs in zip("txyp", ("t", "x", "y", "on"), strict=True):
        plain[theirs] = events[ours]
    np.save(file, plain)
    for title, size in SIZES.items():
        parts = [events[start : start + size] for start in range(0, COUNT, size)]
        command = [sys.executable, "-c", FAERY, str(file), str(size), str(ROUNDS)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        said = {key: spread(value) for key, value in json.loads(done.stdout).items()}
        print(f"\n{title}: Mev per CPU second (times faery's EVT3), bytes an event")
        for key, time_ms in said.items():
            print(f"  {'faery EVT3':20s} {key:7s} {_mev(time_ms):6.1f}")
        for name in ("EVT3", "EVT2", "EVT2.1", "DAT", "mono", "libcaer"):
            found = _ours(name, parts)
            for key, time_ms in found[0].items():
                ratio = said[key].median / time_ms.median
                print(f"  {name:20s} {key:7s} {_mev(time_ms):6.1f} {ratio:5.2f}x  {found[1]:.2f}")
            if name == "EVT3":
                share = _mev(found[0]["write"]) / TARGET_MEV
                print(target(f"EVT3 written, of {TARGET_MEV:g} Mev/s", share, 1.0, "x"))


_CODECS: dict[str, tuple[Any, Any]] = {
    "EVT3": (encode_evt3, decode_evt3),
    "EVT2": (encode_evt2, decode_evt2),
    "EVT2.1": (encode_evt21, decode_evt21),
    "DAT": (encode_dat, decode_dat),
}


def _mev(time_ms: Time) -> float:
    return COUNT / time_ms.median / 1e3


def _ours(name: str, parts: list[Events]) -> tuple[dict[str, Time], float]:
    """CPU times to write and read all packets, and bytes an event."""
    if name in _CODECS:
        encode, decode = _CODECS[name]
        written = [encode(part) for part in parts]
        write = times(lambda: [encode(part) for part in parts])
        read = times(lambda: [decode(data) for data in written])
        return {"write": write, "read": read}, sum(map(len, written)) / COUNT
    writer, reader = PayloadWriter(name), PayloadReader(name)
    payloads = [writer.payload(part) for part in parts]
    write = times(lambda: [writer.payload(part) for part in parts])
    read = times(lambda: [reader.events(data, base) for base, data in payloads])
    return {"write": write, "read": read}, sum(len(data) for _, data in payloads) / COUNT
