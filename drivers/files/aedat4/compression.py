"""AEDAT4's compressions by name and number. The only module that imports lz4 and zstandard.

Each is imported by what uses it: who writes LZ4 loads no ZSTD.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from functools import partial
from typing import BinaryIO

from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.msgs import unknown

NUMBERS = {"none": 0, "lz4": 1, "zstd": 3}
"""What we write. LZ4 is the default: ZSTD is half the size of it and a third of the speed."""

NAMES = {0: "none", 1: "lz4", 2: "lz4_high", 3: "zstd", 4: "zstd_high"}
"""What we read: CompressionType of dv-processing."""

MAGIC = {
    "lz4": b"\x04\x22\x4d\x18",
    "lz4_high": b"\x04\x22\x4d\x18",
    "zstd": b"\x28\xb5\x2f\xfd",
    "zstd_high": b"\x28\xb5\x2f\xfd",
}
"""What a compressed body begins with."""

MAX_BODY_BYTES = 1 << 30
"""No packet or table is larger than this, uncompressed; what states more is damaged."""

_ZSTD_LEVEL = 3
_MAX_WINDOW_BYTES = 1 << 27
_CHUNK_BYTES = 1 << 20


def compressor(name: str) -> Callable[[bytes], bytes]:
    """The function that compresses a body; EvsError for an unknown name.

    Both compressions carry a checksum, so that a reader notices bytes that a disk changed. ZSTD's
    frames must state their uncompressed size: dv-processing refuses others.
    """
    if name not in NUMBERS:
        raise unknown("compression", name, NUMBERS)
    if name == "none":
        return _same
    if name == "lz4":
        import lz4.frame

        return partial(
            lz4.frame.compress, compression_level=0, content_checksum=True, store_size=False
        )
    import zstandard

    return zstandard.ZstdCompressor(
        level=_ZSTD_LEVEL, write_checksum=True, write_content_size=True
    ).compress


def decompress(body: bytes, name: str) -> bytes:
    """The size-prefixed flatbuffer in a body; CorruptDataError if it is torn, changed or too large.

    The output grows as the input really expands, and stops at the size that its own prefix states.
    """
    if name == "none":
        return body
    if frame_bytes(body, name) != len(body):
        raise CorruptDataError("something follows the frame")
    return _bounded(_reader(body, name))


def expanded(body: bytes, name: str, size: int) -> bytes:
    """The content of a frame, which must be `size` bytes; CorruptDataError if it is not."""
    return _filled(bytearray(), _reader(body, name), size)


def unpacked(body: bytes, name: str) -> bytes:
    """The content of a frame of unknown size; CorruptDataError: torn, or over MAX_BODY_BYTES."""
    out, read = bytearray(), _reader(body, name)
    while part := read(_CHUNK_BYTES):
        out += part
        if len(out) > MAX_BODY_BYTES:
            raise CorruptDataError(f"holds over {MAX_BODY_BYTES} bytes")
    return bytes(out)


def decompressed(source: BinaryIO) -> Iterator[bytes]:
    """The parts of a file that is compressed with ZSTD as a whole. CorruptDataError."""
    import zstandard

    plain = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES)
    with plain.stream_reader(source, read_across_frames=True, closefd=False) as reader:
        try:
            while part := reader.read(_CHUNK_BYTES):
                yield part
        except zstandard.ZstdError as reason:
            raise CorruptDataError(f"ZSTD: {reason}") from None


def identifier(body: bytes, name: str) -> bytes:
    """The four letters of a body's type, without decompressing all of it."""
    read = _reader(body, name)
    return (read(12) + bytes(12))[8:12]


def frame_bytes(body: bytes, name: str) -> int:
    """The size, bytes, of the frame (or plain buffer) at the start of `body`.

    By the lengths that stand in it, nothing is decompressed; CorruptDataError where it ends early.
    """
    try:
        if name == "none":
            end = 4 + int.from_bytes(body[:4], "little")
        elif name.startswith("lz4"):
            end = _lz4_frame_bytes(body)
        else:
            end = _zstd_frame_bytes(body)
    except (IndexError, struct.error):
        raise CorruptDataError("the frame ends early") from None
    if end > len(body):
        raise CorruptDataError("the frame ends early")
    return end


def _lz4_frame_bytes(body: bytes) -> int:
    # LZ4 frame format 1.6: magic, FLG, BD, sizes, header checksum, blocks, end mark, checksum
    flags = body[4]
    block_checksum, content_size = 4 * (flags >> 4 & 1), 8 * (flags >> 3 & 1)
    content_checksum, dictionary = 4 * (flags >> 2 & 1), 4 * (flags & 1)
    at = 7 + content_size + dictionary
    while size := struct.unpack_from("<I", body, at)[0]:
        at += 4 + (size & 0x7FFFFFFF) + block_checksum
    return at + 4 + content_checksum


def _zstd_frame_bytes(body: bytes) -> int:
    import zstandard

    # RFC 8878, 3.1.1: header, blocks of a 3-byte header each, checksum
    try:
        at = zstandard.frame_header_size(body)
        checksum = 4 * zstandard.get_frame_parameters(body).has_checksum
    except zstandard.ZstdError as reason:
        raise CorruptDataError(f"ZSTD: {reason}") from None
    last = 0
    while not last:
        header = int.from_bytes((body[at], body[at + 1], body[at + 2]), "little")
        last, kind, size = header & 1, header >> 1 & 3, header >> 3
        # a run-length block holds one byte, whatever its size
        at += 3 + (1 if kind == 1 else size)
    return at + checksum


def _same(body: bytes) -> bytes:
    return body


def _bounded(read: Callable[[int], bytes]) -> bytes:
    """Read everything, which must be as long as its first four bytes state."""
    out = bytearray(read(12))
    if len(out) < 12:
        raise CorruptDataError("the compressed data end early")
    size = 4 + int.from_bytes(out[:4], "little")
    if size > MAX_BODY_BYTES:
        raise CorruptDataError(f"states {size} bytes, over {MAX_BODY_BYTES}")
    return _filled(out, read, size)


def _filled(out: bytearray, read: Callable[[int], bytes], size: int) -> bytes:
    """What was read so far and the rest that read(n) gives, which must be `size` bytes together."""
    # one more byte is requested: it reveals a frame that is too long, and has the end checked
    while len(out) <= size:
        part = read(min(size + 1 - len(out), _CHUNK_BYTES))
        if not part:
            break
        out += part
    if len(out) != size:
        raise CorruptDataError(
            f"states {size} bytes, holds {'more' if len(out) > size else len(out)}"
        )
    return bytes(out)


def _reader(body: bytes, name: str) -> Callable[[int], bytes]:
    if name == "none":
        return io.BytesIO(body).read
    return _read_lz4(body) if name.startswith("lz4") else _read_zstd(body)


def _read_lz4(body: bytes) -> Callable[[int], bytes]:
    import lz4.frame

    frame = lz4.frame.LZ4FrameDecompressor()
    pending = [body]

    def read(count: int) -> bytes:
        # the object forgets that it has ended, and would start again on what follows the frame
        if frame.eof:
            return b""
        try:
            part: bytes = frame.decompress(pending.pop() if pending else b"", max_length=count)
        except RuntimeError as reason:
            raise CorruptDataError(f"LZ4: {reason}") from None
        if not part and not frame.eof:
            raise CorruptDataError("LZ4: the frame ends early")
        return part

    return read


def _read_zstd(body: bytes) -> Callable[[int], bytes]:
    import zstandard

    reader = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES).stream_reader(body)

    def read(count: int) -> bytes:
        try:
            return reader.read(count)
        except zstandard.ZstdError as reason:
            raise CorruptDataError(f"ZSTD: {reason}") from None

    return read
