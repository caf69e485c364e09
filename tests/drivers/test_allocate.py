"""Space for a file is there before it is written, or the file is as it was."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from evs.drivers.allocate import allocate

BYTES = 3_000_001


@pytest.fixture(params=["the system's", "written"])
def file(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[int]:
    """An open file of three bytes, on a system with posix_fallocate and on one without."""
    if request.param == "written":
        monkeypatch.delattr(os, "posix_fallocate")
    number = os.open(tmp_path / "file", os.O_RDWR | os.O_CREAT, 0o600)
    os.write(number, b"abc")
    yield number
    os.close(number)


def test_a_file_gets_space_and_keeps_its_bytes(file: int) -> None:
    allocate(file, BYTES)
    assert os.pread(file, BYTES + 1, 0) == b"abc" + bytes(BYTES - 3)
    assert os.fstat(file).st_blocks * 512 >= BYTES


def test_a_longer_file_is_left_alone(file: int) -> None:
    allocate(file, 2)
    assert os.pread(file, 9, 0) == b"abc"


def test_a_full_disk_leaves_the_file_as_it_was(file: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where zeros are written: half of them fit."""
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    whole = os.pwrite

    def limited(number: int, data: bytes, offset: int) -> int:
        if offset + len(data) > BYTES // 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return whole(number, data, offset)

    monkeypatch.setattr(os, "pwrite", limited)
    with pytest.raises(OSError, match="No space left"):
        allocate(file, BYTES)
    assert os.pread(file, 9, 0) == b"abc"
