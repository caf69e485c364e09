"""A power cut between two sectors of a write to an HDF5 file keeps all that was flushed."""

from __future__ import annotations

import io
import random
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import EventPacket, StreamInfo, make_events

pytestmark = pytest.mark.slow

h5py = pytest.importorskip("h5py")

SECTOR = 512
STATES = 25


class Disk(io.RawIOBase):
    """A file in memory that keeps every write."""

    def __init__(self) -> None:
        self.data, self.at = bytearray(), 0
        self.log: list[tuple[int, bytes]] = []

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, at: int, whence: int = 0) -> int:
        self.at = at + (0, self.at, len(self.data))[whence]
        return self.at

    def tell(self) -> int:
        return self.at

    def readinto(self, buffer: Any) -> int:
        found = bytes(self.data[self.at : self.at + len(buffer)])
        memoryview(buffer).cast("B")[: len(found)] = found
        self.at += len(found)
        return len(found)

    def write(self, data: Any) -> int:
        written(self.data, self.at, bytes(data))
        self.log.append((self.at, bytes(data)))
        self.at += len(data)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        size = self.at if size is None else size
        self.data = self.data[:size].ljust(size, b"\0")
        return size


def written(data: bytearray, at: int, part: bytes) -> None:
    """Write a part of a file; what lies between is zeros."""
    data.extend(bytes(max(0, at + len(part) - len(data))))
    data[at : at + len(part)] = part


@pytest.mark.parametrize("name", ["run.h5", "run.hdf5"])
def test_a_torn_sector_loses_nothing_that_was_flushed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, flushed, sink = Disk(), [(0, 0)], files.recorder_for(tmp_path / name)
    made: Any = sink
    # as many chunks as in hours of recording
    monkeypatch.setattr(type(made), "CHUNK", 256)

    def create(_path: Path, mode: str, **options: Any) -> Any:
        return h5py.File(disk, mode, **options)

    made._h5py = SimpleNamespace(File=create, string_dtype=h5py.string_dtype)
    commit = made._commit

    def noted(count: int) -> None:
        commit(count)
        flushed.append((len(disk.log), count))

    made._commit = noted
    made._move_into_place = lambda _path: (tmp_path / name).touch()
    sink.open([StreamInfo(64, 48)])
    stamps = np.sort(np.random.default_rng(0).integers(0, 60_000_000, 20_000))
    for seq, t in enumerate(np.array_split(stamps, 60)):
        events = make_events(t, t % 64, t % 48, t % 2)
        sink.write(EventPacket(seq, int(t[0]), int(t[-1]), 64, 48, events))
    log = list(disk.log)
    sink.close()

    torn = [
        (number, at, part)
        for number, (at, part) in enumerate(log)
        if at // SECTOR != (at + len(part) - 1) // SECTOR and number > flushed[2][0]
    ]
    chance = random.Random(1)
    for number, at, part in chance.sample(torn, min(STATES, len(torn))):
        data = bytearray()
        for place, bytes_there in log[:number]:
            written(data, place, bytes_there)
        edges = range((at // SECTOR + 1) * SECTOR, at + len(part), SECTOR)
        written(data, at, part[: chance.choice(edges) - at])
        path = tmp_path / f"torn{Path(name).suffix}"
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = files.read(path)
        count = max(count for end, count in flushed if end <= number)
        assert len(found) >= count
        assert found["t"][:count].tolist() == stamps[:count].tolist()
