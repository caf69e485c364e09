"""Formats' encoders and decoders beside each other, and convert between them, in processor time."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import EventPacket, Events, StreamInfo, make_events

COUNT, PACKET = 1_000_000, 1000
KINDS = {"aedat4": ".aedat4", "aedat2": ".aedat", "aedat3": ".aedat3", "csv": ".csv", "npz": ".npz"}


def packets() -> list[Events]:
    random = np.random.default_rng(0)
    t = np.arange(COUNT, dtype=np.int64) + 1
    x, y = random.integers(0, 346, COUNT), random.integers(0, 260, COUNT)
    events = make_events(t, x, y, random.integers(0, 2, COUNT))
    return np.split(events, COUNT // PACKET)


@pytest.mark.bench
def test_files_are_written_read_and_converted_at(tmp_path: Path) -> None:
    parts = packets()
    print(f"\n{'format':8s} {'write':>7s} {'read':>7s} {'to .aedat4':>10s}  Mev/s, 1 ms packets")
    for kind, suffix in KINDS.items():
        path = tmp_path / f"a{suffix}"
        sink = files.recorder_for(path)
        sink.open([StreamInfo(346, 260)])
        begin = time.process_time()
        for seq, events in enumerate(parts):
            sink.write(EventPacket(seq, 0, 0, 346, 260, events))
        sink.close()
        write = time.process_time() - begin
        begin = time.process_time()
        assert len(files.read(path)) == COUNT
        read = time.process_time() - begin
        begin = time.process_time()
        assert files.convert(path, tmp_path / "made.aedat4").events == COUNT
        there = time.process_time() - begin
        rates = [COUNT / taken / 1e6 for taken in (write, read, there)]
        print(f"{kind:8s} {rates[0]:7.1f} {rates[1]:7.1f} {rates[2]:10.1f}")
