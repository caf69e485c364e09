"""Stacks in an .npz file: what comes back, after every frame and after every kind of end."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.files.npz import zip_archive
from evs.drivers.files.npz.frame_writer import FrameArray, NpzFrameWriter
from evs.drivers.search_path import search_path
from evs.msgs import EvsError

CHANNELS = {
    "t_us": FrameArray("<i8"),
    "light": FrameArray("<f4", (5, 7)),
    "flow": FrameArray("<f4", (5, 7, 2)),
    "empty": FrameArray("<i4", (0, 3)),
}
TEXTS = {"info": '{"camera": "eye", "sign": "\N{GREEK SMALL LETTER MU}"}', "blank": ""}


def frame(k: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(k)
    return {
        "t_us": np.array(1000 * k),
        "light": rng.normal(size=(5, 7)).astype(np.float32),
        "flow": rng.normal(size=(5, 7, 2)).astype(np.float32),
        "empty": np.zeros((0, 3), np.int32),
    }


def expect(path: Path, frames: int) -> None:
    with zipfile.ZipFile(path) as archived:
        assert archived.testzip() is None
    with np.load(path) as file:
        assert set(file.files) == {*CHANNELS, *TEXTS}
        for name, channel in CHANNELS.items():
            stack = file[name]
            assert stack.shape == (frames, *channel.shape)
            assert stack.dtype == np.dtype(channel.dtype)
            for k in range(frames):
                np.testing.assert_array_equal(stack[k], frame(k)[name])
        for name, text in TEXTS.items():
            assert str(file[name]) == text


@pytest.mark.parametrize("frames", [0, 1, 2, 11])
def test_what_goes_in_comes_back(tmp_path: Path, frames: int) -> None:
    path = tmp_path / "a.npz"
    writer = NpzFrameWriter(path, frames, CHANNELS, TEXTS)
    for k in range(frames):
        writer.write(frame(k))
    assert writer.close() == path.stat().st_size
    assert writer.close() == path.stat().st_size
    expect(path, frames)
    with pytest.raises(ValueError, match=f"for {frames} frames"):
        writer.write(frame(0))


def test_it_can_be_read_after_every_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    writer = NpzFrameWriter(path, 12, CHANNELS, TEXTS)
    expect(path, 0)
    for k in range(12):
        writer.write(frame(k))
        expect(path, k + 1)
    writer.close()


@pytest.mark.parametrize("done", [0, 1, 5])
def test_an_early_end_leaves_no_gaps(tmp_path: Path, done: int) -> None:
    early, whole = tmp_path / "early.npz", tmp_path / "whole.npz"
    for path, frames in ((early, 1000), (whole, done)):
        writer = NpzFrameWriter(path, frames, CHANNELS, TEXTS)
        for k in range(done):
            writer.write(frame(k))
        assert writer.close() == path.stat().st_size
    expect(early, done)
    assert early.read_bytes() == whole.read_bytes()


def test_an_early_end_moves_more_than_a_chunk(tmp_path: Path) -> None:
    path, shape = tmp_path / "a.npz", (700, 900)
    channels = {"a": FrameArray("<f4", shape), "b": FrameArray("<f4", shape)}
    writer = NpzFrameWriter(path, 8, channels, {})
    for k in range(4):
        writer.write({"a": np.full(shape, k), "b": np.full(shape, -k)})
    writer.close()
    with np.load(path) as file:
        for k in range(4):
            assert (file["a"][k] == k).all()
            assert (file["b"][k] == -k).all()


def test_a_file_that_is_there_is_written_over(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(b"x" * 100_000)
    writer = NpzFrameWriter(path, 1, CHANNELS, TEXTS)
    writer.write(frame(0))
    writer.close()
    expect(path, 1)


KILLED = """
import os, signal
import numpy as np
from evs.drivers.files.npz.frame_writer import FrameArray, NpzFrameWriter
channels = {{"x": FrameArray("<i8", (3,)), "y": FrameArray("<f4", (2, 2))}}
writer = NpzFrameWriter({path!r}, 50, channels, {{}})
for k in range(7):
    writer.write({{"x": np.full(3, k), "y": np.full((2, 2), k)}})
put, left = os.pwrite, {writes}
def last(file, data, offset):
    global left
    left -= 1
    if left < 0:
        put(file, bytes(data)[:len(data) // 2], offset)
        os.kill(os.getpid(), signal.SIGKILL)
    return put(file, data, offset)
os.pwrite = last
writer.write({{"x": np.full(3, 7), "y": np.full((2, 2), 7)}})
"""


@pytest.mark.integration
@pytest.mark.parametrize("writes", [0, 1])
def test_a_killed_process_leaves_its_frames(tmp_path: Path, writes: int) -> None:
    path = tmp_path / "a.npz"
    program = KILLED.format(path=str(path), writes=writes)
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": search_path()}, timeout=60
    )
    assert done.returncode == -9
    with np.load(path) as file:
        np.testing.assert_array_equal(file["x"], np.arange(7)[:, np.newaxis].repeat(3, 1))
        assert file["y"].shape == (7, 2, 2)


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "device.npz").symlink_to("/dev/full")
    for name, says in (
        ("nowhere/a.npz", "mkdir -p"),
        ("folder.npz", "it is a folder"),
        ("device.npz", "no file"),
    ):
        with pytest.raises(EvsError, match=says):
            NpzFrameWriter(tmp_path / name, 1, CHANNELS, TEXTS)


@pytest.fixture
def small_files():
    """No file may grow over 20 kB, which looks like a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_is_too_small_is_told_before_anything_is_lost(
    tmp_path: Path, small_files: None
) -> None:
    new, old = tmp_path / "new.npz", tmp_path / "old.npz"
    old.write_bytes(b"precious")
    for path in (new, old):
        with pytest.raises(EvsError, match=r"cannot write .*0\.4 MB are needed"):
            NpzFrameWriter(path, 1000, CHANNELS, TEXTS)
    assert not new.exists()
    assert old.read_bytes() == b"precious"


def test_a_disk_that_fails_on_the_way_keeps_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, calls = tmp_path / "a.npz", 0
    writer = NpzFrameWriter(path, 9, CHANNELS, TEXTS)
    for k in range(4):
        writer.write(frame(k))
    good = os.pwrite
    with monkeypatch.context() as broken:

        def fail(file: int, data: memoryview, offset: int) -> int:
            nonlocal calls
            calls += 1
            if calls > 2:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return good(file, data, offset)

        broken.setattr(os, "pwrite", fail)
        with pytest.raises(EvsError, match="stopped at frame 4 of 9: Input/output error"):
            writer.write(frame(4))
    assert calls == 3
    expect(path, 4)
    writer.close()
    expect(path, 4)


def test_a_frame_of_another_shape_is_refused(tmp_path: Path) -> None:
    writer = NpzFrameWriter(tmp_path / "a.npz", 1, {"x": FrameArray("<f4", (2, 2))}, {})
    with pytest.raises(ValueError, match=r"x is \(3,\), not \(2, 2\)"):
        writer.write({"x": np.zeros(3)})
    writer.close()


@given(st.binary(max_size=300), st.binary(max_size=300))
def test_checksums_of_pieces_join(front: bytes, back: bytes) -> None:
    shift = zip_archive.zeros(len(back))
    assert zip_archive.crc32_combine(zlib.crc32(front), shift, zlib.crc32(back)) == zlib.crc32(
        front + back
    )


def test_archives_over_four_gigabytes_are_described_in_64_bits(tmp_path: Path) -> None:
    # a sparse file: a member whose header stands at 5 GB
    body = b"hello"
    member = zip_archive.Member("a.txt", 5 << 30, len(body), zlib.crc32(body))
    head, path = zip_archive.header(member), tmp_path / "a.zip"
    end = member.offset + len(head) + len(body)
    with path.open("wb") as file:
        file.seek(member.offset)
        file.write(head + body + zip_archive.directory([member], end))
    with zipfile.ZipFile(path) as archived:
        assert archived.read("a.txt") == body
