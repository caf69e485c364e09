"""NpzFrameWriter: arrays that grow frame by frame in one .npz file, readable at any time."""

from __future__ import annotations

import io
import os
import stat
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.allocate import allocate
from evs.drivers.files.npz import zip_archive
from evs.drivers.files.paths import target_error
from evs.msgs import EvsError

_CHUNK_BYTES = 1 << 22


@dataclass(frozen=True)
class FrameArray:
    """One array of the file: dtype and shape of each frame."""

    dtype: str
    """as numpy writes it, byte order included: "<f4" """
    shape: tuple[int, ...] = ()
    """of one frame"""


@dataclass
class _ArrayMember:
    """Position of an array in the file, and the checksum of its content."""

    name: str
    channel: FrameArray
    offset: int
    shift: zip_archive.Operator = field(default_factory=lambda: zip_archive.zeros(0))
    """of all frames so far"""
    crc: int = 0
    """of all frames so far"""

    def __post_init__(self) -> None:
        dtype = np.dtype(self.channel.dtype)
        self.frame_bytes = dtype.itemsize * int(np.prod(self.channel.shape, dtype=np.int64))
        self.step = zip_archive.zeros(self.frame_bytes)
        self.head_bytes = len(self.head(0))

    def head(self, frames: int) -> bytes:
        """The bytes before the first frame; their length is the same for any number of frames."""
        npy = _npy_header(self.channel.dtype, (frames, *self.channel.shape))
        return zip_archive.header(self.member(frames, npy)) + npy

    def member(self, frames: int, npy: bytes | None = None) -> zip_archive.Member:
        """Its entry in the archive's directory."""
        npy = npy or _npy_header(self.channel.dtype, (frames, *self.channel.shape))
        crc = zip_archive.crc32_combine(zlib.crc32(npy), self.shift, self.crc)
        size = len(npy) + frames * self.frame_bytes
        return zip_archive.Member(f"{self.name}.npy", self.offset, size, crc)

    def frame_offset(self, frame: int) -> int:
        """Byte offset of a frame."""
        return self.offset + self.head_bytes + frame * self.frame_bytes


class NpzFrameWriter:
    """Writes an .npz file of known length frame by frame.

    Room for all frames is taken first, so a disk that is too small is reported at the start. After
    each frame the file is a complete archive of all frames until then, and stays one while the next
    frame's values are written, so a process that is killed leaves what it had done. Not so in the
    microseconds in which the lengths change, and while `close` moves the stacks of an early end
    together: an archive that was cut off there is refused by numpy.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        frames: int,
        channels: Mapping[str, FrameArray],
        texts: Mapping[str, str],
    ) -> None:
        """Open the file. A file that is there already is overwritten once there is room.

        Args:
            path: The file.
            frames: How many frames it will hold.
            channels: Name to the shape and dtype of one frame's array.
            texts: Name to what becomes a zero-dimensional string array.

        Raises:
            EvsError: The file cannot be written, or the disk has no room for it.
        """
        self.path, self.frames, self.written = Path(path), frames, 0
        self._texts, texts_bytes = _texts(texts)
        self._arrays: list[_ArrayMember] = []
        at = len(texts_bytes)
        for name, channel in channels.items():
            one = _ArrayMember(name, channel, at)
            at = one.frame_offset(frames)
            self._arrays.append(one)
        self._end = at
        self._size = at + len(self._directory())
        try:
            # an object, so that a writer that is dropped leaves no descriptor open
            self._file = io.FileIO(self._open(), "r+")
            self._write_at(0, texts_bytes)
            self._write_headers()
        except OSError as reason:
            raise target_error(self.path, reason) from None

    def write(self, frame: Mapping[str, npt.NDArray[Any]]) -> None:
        """Append one frame of every array. EvsError: the disk failed; earlier frames stay."""
        if self.written == self.frames:
            raise ValueError(f"{self.path} was opened for {self.frames} frames")
        try:
            crcs = []
            for one in self._arrays:
                value = np.asarray(frame[one.name], one.channel.dtype)
                if value.shape != one.channel.shape:
                    raise ValueError(f"{one.name} is {value.shape}, not {one.channel.shape}")
                data = value.tobytes()
                self._write_at(one.frame_offset(self.written), data)
                crcs.append(zlib.crc32(data))
            # the frame counts once all of it is there
            for one, crc in zip(self._arrays, crcs, strict=True):
                one.crc = zip_archive.crc32_combine(one.crc, one.step, crc)
                one.shift = zip_archive.compose(one.step, one.shift)
            self.written += 1
            self._write_headers()
        except OSError as reason:
            raise EvsError(
                f"writing {self.path} stopped at frame {self.written} of {self.frames}: "
                f"{reason.strerror}"
            ) from None

    def close(self) -> int:
        """Close the file, compacting it after an early end; returns its size in bytes."""
        if self._file.closed:
            return self._size
        try:
            if self.written < self.frames:
                self._compact()
            self._file.truncate(self._size)
        except OSError as reason:
            raise target_error(self.path, reason) from None
        finally:
            self._file.close()
        return self._size

    def _open(self) -> int:
        """Open a file and allocate its final size; an existing file stays if there is no space."""
        before = self.path.stat().st_size if self.path.is_file() else None
        file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(file).st_mode):
                raise OSError(0, "it is no file that can be filled in any order")
            allocate(file, self._size)
            os.ftruncate(file, self._size)
        except OSError as reason:
            if before is not None:
                os.ftruncate(file, before)
            elif stat.S_ISREG(os.fstat(file).st_mode):
                self.path.unlink()
            os.close(file)
            if reason.errno:
                reason.strerror = f"{reason.strerror} ({self._size / 1e6:.1f} MB are needed)"
            raise
        return file

    def _write_at(self, offset: int, data: bytes) -> None:
        view = memoryview(data)
        while view:
            done = os.pwrite(self._file.fileno(), view, offset)
            offset, view = offset + done, view[done:]

    def _write_headers(self) -> None:
        """Write the headers that make the frames so far an archive."""
        heads = [(one.offset, one.head(self.written)) for one in self._arrays]
        # nothing but writing in between: the moment when they do not agree is short
        for offset, data in [*heads, (self._end, self._directory())]:
            self._write_at(offset, data)

    def _directory(self) -> bytes:
        members = [one.member(self.written) for one in self._arrays]
        return zip_archive.directory([*self._texts, *members], self._end)

    def _compact(self) -> None:
        """Close the gaps of missing frames."""
        at = self._arrays[0].offset if self._arrays else self._end
        for one in self._arrays:
            begin, length = one.frame_offset(0), self.written * one.frame_bytes
            one.offset = at
            target = one.frame_offset(0)
            for done in range(0, length, _CHUNK_BYTES):
                count = min(_CHUNK_BYTES, length - done)
                self._write_at(target + done, os.pread(self._file.fileno(), count, begin + done))
            at = one.frame_offset(self.written)
        self._end = at
        self._size = at + len(self._directory())
        self._write_headers()


def _npy_header(dtype: str, shape: tuple[int, ...]) -> bytes:
    # numpy pads it, so that the first number may grow to 21 digits
    out = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)
    return out.getvalue()


def _texts(texts: Mapping[str, str]) -> tuple[list[zip_archive.Member], bytes]:
    """Members for string arrays, and their bytes at the start of the file."""
    members, data = [], b""
    for name, text in texts.items():
        out = io.BytesIO()
        np.lib.format.write_array(out, np.array(text), allow_pickle=False)
        body = out.getvalue()
        member = zip_archive.Member(f"{name}.npy", len(data), len(body), zlib.crc32(body))
        members.append(member)
        data += zip_archive.header(member) + body
    return members, data
