"""AEDAT4's buffers against the flatbuffers library; its compressions against their own."""

from __future__ import annotations

import flatbuffers
import lz4.frame
import numpy as np
import pytest
import zstandard
from flatbuffers import number_types
from flatbuffers.table import Table

from evs.drivers.files.aedat4 import compression, description, layout
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.msgs import EvsError, StreamInfo, empty_events, make_events

EVENTS = make_events([1, 2**40, 2**40], [0, 345, 7], [0, 259, 9], [1, 0, 1])


def built(count: int, data: bytes) -> bytes:
    """An EVTS buffer as the library's builder makes it."""
    builder = flatbuffers.Builder(len(data) + 64)
    builder.StartVector(16, count, 8)
    builder.head -= len(data)
    builder.Bytes[builder.head : builder.head + len(data)] = data
    vector = builder.EndVector()
    builder.StartObject(1)
    builder.PrependUOffsetTRelativeSlot(0, vector, 0)
    builder.FinishSizePrefixed(builder.EndObject(), file_identifier=b"EVTS")
    return bytes(builder.Output())


@pytest.mark.parametrize("events", [EVENTS, EVENTS[:1], empty_events(), np.tile(EVENTS, 999)])
def test_the_constant_prefix_is_what_the_builder_makes(events: np.ndarray) -> None:
    assert layout.events_body(events) == built(len(events), events.tobytes())
    assert layout.parse_events(layout.events_body(events)).tobytes() == events.tobytes()


def test_events_without_elements_are_none() -> None:
    builder = flatbuffers.Builder(64)
    builder.StartObject(1)
    builder.FinishSizePrefixed(builder.EndObject(), file_identifier=b"EVTS")
    assert len(layout.parse_events(bytes(builder.Output()))) == 0


def test_the_data_table_is_read_by_the_library() -> None:
    columns = np.random.default_rng(0).integers(0, 2**31, (300, layout.TABLE_COLUMNS))
    columns[:, 0] += 2**40
    for padding in (b"", bytes(range(8)), bytes(8000)):
        body = layout.data_table(3, columns, padding)
        assert layout.parse_table_length(body) == 300
        root = Table(body, 4 + int.from_bytes(body[4:8], "little"))
        listed = root.Vector(root.Offset(4))
        assert root.VectorLen(root.Offset(4)) == 300
        for row in range(300):
            entry = Table(body, root.Indirect(listed + 4 * row))
            at = [entry.Pos + entry.Offset(slot) for slot in (4, 6, 8, 10, 12)]
            assert all(position % 8 == 0 for position in (at[0], *at[2:]))
            found = [
                entry.Get(number_types.Int64Flags, at[0]),
                entry.Get(number_types.Int32Flags, at[1] + 4),
                *(entry.Get(number_types.Int64Flags, position) for position in at[2:]),
            ]
            assert found == columns[row].tolist()
            assert entry.Get(number_types.Int32Flags, at[1]) == 3


def test_the_header_has_one_length_wherever_the_table_lies() -> None:
    headers = [layout.io_header(1, "<dv>é</dv>", position) for position in (-1, 0, 2**62)]
    assert len({len(header) for header in headers}) == 1
    for header, position in zip(headers, (-1, 0, 2**62), strict=True):
        found = layout.parse_io_header(header)
        assert (found.compression, found.table_position, found.xml) == (1, position, "<dv>é</dv>")
        at = found.table_position_at
        assert at is not None
        assert header[at : at + 8] == position.to_bytes(8, "little", signed=True)


@pytest.mark.parametrize("name", compression.NUMBERS)
def test_compressed_bodies_are_ordinary_frames_and_come_back(name: str) -> None:
    body = layout.events_body(np.tile(EVENTS, 30_000))
    packed = compression.compressor(name)(body)
    assert compression.decompress(packed, name) == body
    assert compression.identifier(packed, name) == b"EVTS"
    assert compression.frame_bytes(packed + b"behind", name) == len(packed)
    if name == "lz4":
        assert lz4.frame.decompress(packed) == body
        # frames of other writers: sizes, checksums and block sizes as they like
        for options in (
            {"store_size": True},
            {"block_checksum": True, "block_size": lz4.frame.BLOCKSIZE_MAX1MB},
            {"block_linked": False, "content_checksum": True, "compression_level": 9},
        ):
            other = lz4.frame.compress(body, **options)
            assert compression.frame_bytes(other + b"behind", name) == len(other)
            assert compression.decompress(other, name) == body
    if name == "zstd":
        assert zstandard.ZstdDecompressor().decompress(packed) == body
        for options in ({"write_content_size": False}, {"level": 12}, {"write_checksum": True}):
            for content in (body, body[:4] + bytes(len(body) - 4)):
                other = zstandard.ZstdCompressor(**options).compress(content)
                assert compression.frame_bytes(other + b"behind", name) == len(other)
                assert compression.decompress(other, name) == content


@pytest.mark.parametrize("name", ["lz4", "zstd"])
def test_any_changed_bit_and_any_cut_of_a_compressed_body_is_noticed(name: str) -> None:
    body = layout.events_body(EVENTS)
    packed = compression.compressor(name)(body)
    for cut in range(len(packed)):
        with pytest.raises(CorruptDataError):
            compression.decompress(packed[:cut], name)
    with pytest.raises(CorruptDataError, match="something follows"):
        compression.decompress(packed + b"x", name)
    for bit in range(8 * len(packed)):
        changed = bytearray(packed)
        changed[bit // 8] ^= 1 << bit % 8
        try:
            # a bit that says how to decode (e.g. LZ4's block independence) may make no difference
            assert compression.decompress(bytes(changed), name) == body
        except CorruptDataError:
            continue


@pytest.mark.parametrize("name", ["lz4", "zstd"])
def test_a_bomb_is_stopped_at_the_size_it_states(name: str) -> None:
    pack = compression.compressor(name)
    lying = pack((100).to_bytes(4, "little") + bytes(50_000_000))
    with pytest.raises(CorruptDataError, match="states 104 bytes, holds more"):
        compression.decompress(lying, name)
    huge = pack((2**31).to_bytes(4, "little") + bytes(1000))
    with pytest.raises(CorruptDataError, match="over"):
        compression.decompress(huge, name)


def test_an_unknown_compression_says_what_there_is() -> None:
    with pytest.raises(EvsError, match="no compression 'lz5'; there is: lz4"):
        compression.compressor("lz5")


def test_a_buffer_that_lies_is_refused() -> None:
    body = layout.events_body(EVENTS)
    count = body.index((3).to_bytes(4, "little"), 20)
    for wrong in (
        body[:-1],
        body + b"x",
        body[:8] + b"FRME" + body[12:],
        body[:4] + (2**32 - 1).to_bytes(4, "little") + body[8:],
        body[:count] + (4).to_bytes(4, "little") + body[count + 4 :],
        body[:count] + (2**32 - 1).to_bytes(4, "little") + body[count + 4 :],
        b"",
    ):
        with pytest.raises(CorruptDataError):
            layout.parse_events(wrong)


def test_a_description_that_is_none_is_refused() -> None:
    for text in ("<dv>", "", "<!DOCTYPE a [<!ENTITY b 'c'>]><dv>&b;</dv>", "\0"):
        with pytest.raises(CorruptDataError):
            description.from_xml(text)
    assert description.from_xml("<dv/>") == {}
    bad = {"sizeX": "-5", "sizeY": "9" * 5000, "tick_us": "0", "seed": '"x"', "config": "[" * 9999}
    assert description.stream_info(bad, 4, 3) == StreamInfo(4, 3, sensor="unknown", tick_us=1)
