"""Aedat4File and repair on files that are torn, damaged, foreign, or no AEDAT4 at all."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files import LeftOutWarning, packets, read, summary
from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder, compression, layout, reader, repair
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning, TornTailWarning
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, join_events, make_events
from reference.streams import random_events

STREAM = StreamInfo(64, 48, camera="eye", seed=5)
COMPRESSIONS = ("none", "lz4", "zstd")


def events_of(tick: int) -> Events:
    return random_events(20, 1000 * tick, 1000 * tick + 1000, (64, 48), tick)


def record(path: Path, compression: str, ticks: int = 5, close: bool = True) -> list[int]:
    """Offsets at which the packets begin, and the end of the last."""
    sink = Aedat4Recorder(path, compression)
    sink.open([STREAM])
    ends = [path.stat().st_size]
    for tick in range(ticks):
        sink.write(EventPacket(tick, 0, 0, 64, 48, events_of(tick)))
        ends.append(path.stat().st_size)
    killed = path.read_bytes()
    sink.close()
    if not close:
        path.write_bytes(killed)
    return ends


def whole(ticks: range | list[int]) -> Events:
    return join_events([events_of(tick) for tick in ticks])


@pytest.mark.slow
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_file_cut_anywhere_in_its_last_packet_keeps_the_others(
    tmp_path: Path, compression: str
) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, compression, close=False)
    data = path.read_bytes()
    for cut in range(ends[-2] + 1, ends[-1]):
        path.write_bytes(data[:cut])
        with pytest.warns(TornTailWarning, match=f" {cut - ends[-2]} bytes at offset {ends[-2]} "):
            recording = read(path)
        assert recording.tobytes() == whole(range(4)).tobytes()
        found = repair(path)
        assert (found.cut_bytes, found.cut_at) == (cut - ends[-2], ends[-2])
        assert f"cut {cut - ends[-2]} bytes at offset {ends[-2]}" in str(found)
        assert path.read_bytes() == data[: ends[-2]]
        again = repair(path)
        assert not again.needed
        assert str(again) == f"{path} needs no repair"
        assert read(path).tobytes() == whole(range(4)).tobytes()


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_file_cut_anywhere_in_its_table_keeps_every_packet(
    tmp_path: Path, compression: str
) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, compression)
    data = path.read_bytes()
    edges = [*range(ends[-1], ends[-1] + 60), *range(len(data) - 60, len(data))]
    for cut in sorted({*edges, *range(ends[-1], len(data), 41)}):
        path.write_bytes(data[:cut])
        found = summary(path)
        assert (found.events, found.table, found.broken_pointer) == (100, False, True)
        assert found.torn_bytes == cut - ends[-1]
        done = repair(path)
        assert done.needed
        assert done.pointer_reset
        assert path.stat().st_size == ends[-1]
        found = summary(path)
        assert (found.events, found.broken_pointer, found.torn_at) == (100, False, None)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize(
    "tail", [b"x", bytes(7), bytes(5000), os.urandom(3000), struct.pack("<ii", 0, -1) * 9]
)
def test_garbage_at_the_end_is_left_out_and_cut(
    tmp_path: Path, compression: str, tail: bytes
) -> None:
    path = tmp_path / "a.aedat4"
    record(path, compression)
    data = path.read_bytes()
    path.write_bytes(data + tail)
    with pytest.warns(TornTailWarning, match=f" {len(tail)} bytes at offset {len(data)} "):
        assert read(path).tobytes() == whole(range(5)).tobytes()
    assert repair(path).cut_bytes == len(tail)
    assert path.read_bytes() == data


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("close", [True, False])
def test_damage_between_packets_costs_those_packets_only(
    tmp_path: Path, compression: str, close: bool
) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, compression, close=close)
    data = path.read_bytes()
    size = struct.unpack_from("<i", data, ends[2] + 4)[0]
    # the header's size too large, too small, negative, past the end; the body's beginning
    for at, value in (
        (4, size + 5),
        (4, size - 1),
        (4, 0),
        (4, -7),
        (4, 2**31 - 1),
        (8, 0),
        (0, 77),
    ):
        changed = bytearray(data)
        struct.pack_into("<i", changed, ends[2] + at, value)
        path.write_bytes(changed)
        with pytest.warns(DamagedPacketWarning, match=f"1 damaged .* at byte {ends[2]}"):
            recording = read(path)
        assert recording.tobytes() == whole([0, 1, 3, 4]).tobytes()
        # nothing to cut: whole packets follow
        assert not repair(path).needed
        assert path.read_bytes() == changed


def test_a_packet_whose_values_cannot_be_is_left_out(tmp_path: Path) -> None:
    for column, value in (("t", 2**62 + 1), ("x", 64), ("x", -1), ("y", 48), ("t", -(10**7))):
        path = tmp_path / "a.aedat4"
        sink = Aedat4Recorder(path)
        sink.open([STREAM])
        for tick in range(3):
            events = events_of(tick)
            if tick == 1:
                events[column][-1] = value
            sink.write(EventPacket(tick, 0, 0, 64, 48, events))
        sink.close()
        with pytest.warns(DamagedPacketWarning, match="1 damaged"):
            assert read(path).tobytes() == whole([0, 2]).tobytes()
        assert not repair(path).needed


def test_stamps_out_of_order_in_a_packet_are_sorted_and_told(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    sink = Aedat4Recorder(path)
    sink.open([STREAM])
    events = make_events([10, 30, 20, 40], [1, 2, 3, 4], [0] * 4, [1] * 4)
    sink.write(EventPacket(0, 0, 0, 64, 48, events))
    sink.write(EventPacket(1, 0, 0, 64, 48, events_of(1)))
    sink.close()
    with pytest.warns(BackwardsWarning, match="1 time stamps ran backwards and were sorted; the"):
        assert read(path)["x"][:4].tolist() == [1, 3, 2, 4]
    assert summary(path).damaged_packets == 0


def test_polarity_and_padding_of_another_writer_are_put_right(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, "none", ticks=1)
    data = bytearray(path.read_bytes())
    data[ends[0] + 40 + 12 : ends[0] + 40 + 16] = b"\x80\x01\x02\x03"
    path.write_bytes(data)
    recording = read(path)
    assert recording["p"][0] == 1
    assert recording[0].tobytes()[13:] == bytes(3)
    assert recording[1:].tobytes() == events_of(0)[1:].tobytes()


def foreign(path: Path, xml: str, bodies: list[tuple[int, bytes]]) -> None:
    """A file as another program might write it, LZ4."""
    pack = compression.compressor("lz4")
    parts = [layout.MAGIC, layout.io_header(1, xml)]
    for stream, body in bodies:
        packed = pack(body)
        parts += [layout.PACKET_HEADER.pack(stream, len(packed)), packed]
    path.write_bytes(b"".join(parts))


def declared(*streams: tuple[int, str, str]) -> str:
    nodes = "".join(
        f"<node name='{number}'><attr key='typeIdentifier'>{kind}</attr>"
        f"<node name='info'>{info}</node></node>"
        for number, kind, info in streams
    )
    return f"<dv version='2.0'><node name='outInfo'>{nodes}</node></dv>"


SIZE = "<attr key='sizeX'>64</attr><attr key='sizeY'>48</attr><attr key='source'>DVX</attr>"
FRAME = layout.events_body(events_of(9)).replace(b"EVTS", b"FRME")
BODIES = [(1, FRAME), (4, layout.events_body(events_of(0))), (1, FRAME)]


def test_the_event_stream_is_found_by_its_declaration(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    foreign(path, declared((1, "FRME", ""), (4, "EVTS", SIZE)), BODIES)
    recording = read(path)
    assert recording.tobytes() == events_of(0).tobytes()
    assert recording.stream == StreamInfo(
        64, 48, camera="DVX", sensor="unknown", tick_us=1, frames=True
    )


@pytest.mark.parametrize("xml", ["<dv/>", declared((1, "FRME", ""), (4, "EVTS", ""))])
def test_an_undeclared_stream_or_size_is_found_in_the_packets(tmp_path: Path, xml: str) -> None:
    path = tmp_path / "a.aedat4"
    foreign(path, xml, BODIES)
    recording = read(path)
    assert recording.tobytes() == events_of(0).tobytes()
    assert recording.stream.width == 1 + events_of(0)["x"].max()
    assert recording.stream.height == 1 + events_of(0)["y"].max()


def test_of_two_event_streams_the_first_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    second = (2, layout.events_body(events_of(1)))
    foreign(path, declared((2, "EVTS", SIZE), (4, "EVTS", SIZE)), [*BODIES[1:2], second])
    with pytest.warns(LeftOutWarning, match="events of stream 4"):
        assert read(path).tobytes() == events_of(1).tobytes()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "does not begin with the AEDAT4 line"),
        (b"#!AER-DAT3.1\r\n" + bytes(90), "does not begin with the AEDAT4 line"),
        (layout.MAGIC, "its header is torn"),
        (layout.MAGIC + b"\xff\xff\xff\xff" + bytes(90), "its header is torn"),
        (layout.MAGIC + layout.io_header(1, "<dv/>")[:-1], "its header is torn"),
        (layout.MAGIC + layout.io_header(9, "<dv/>"), "compression 9 does not exist"),
        (layout.MAGIC + layout.io_header(1, "<dv>"), "not XML"),
        (layout.MAGIC + layout.io_header(1, "<dv/>"), "neither declares nor holds"),
        (layout.MAGIC + layout.io_header(1, declared((0, "POSE", SIZE))), "neither declares"),
    ],
)
def test_what_is_no_aedat4_is_refused_in_one_line(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.aedat4"
    path.write_bytes(data)
    for look in (read, summary, repair):
        with pytest.raises(EvsError, match=says) as caught:
            look(path)
        assert "\n" not in str(caught.value)
    assert path.read_bytes() == data


def test_repair_leaves_a_file_alone_of_which_nothing_would_be_left(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    record(path, "lz4")
    data = path.read_bytes()
    # the header's compression says ZSTD
    wrong = data.replace(struct.pack("<i", 1), struct.pack("<i", 3), 1)
    path.write_bytes(wrong)
    assert Aedat4File.at(path).compression == "zstd"
    with pytest.raises(EvsError, match="repair leaves it as it is"):
        repair(path)
    assert path.read_bytes() == wrong


def test_a_first_packet_that_is_torn_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, "lz4", ticks=1, close=False)
    path.write_bytes(path.read_bytes()[:-1])
    assert repair(path).cut_at == ends[0]
    assert len(read(path)) == 0


def test_a_file_that_cannot_be_written_is_not_repaired(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.aedat4"
    record(path, "lz4", close=False)
    path.write_bytes(path.read_bytes() + b"tail")
    plain = Path.open

    def read_only(self: Path, mode: str = "r", *rest: object) -> object:
        if "+" in mode:
            raise PermissionError(13, "Permission denied")
        return plain(self, mode, *rest)

    monkeypatch.setattr(Path, "open", read_only)
    with pytest.raises(EvsError, match="Permission denied; choose a place"):
        repair(path)


def test_a_recording_is_an_array_that_knows_its_stream(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    record(path, "lz4")
    recording = read(str(path))
    assert recording.stream == STREAM
    assert recording[3:7].stream == STREAM
    assert recording[recording["p"] == 1].stream == STREAM
    assert recording.copy().stream == STREAM
    # columns are plain, and so is what NumPy makes of them
    share = (recording["p"] > 0).mean()
    assert round(share, 3) == round(float(np.mean(np.asarray(recording)["p"] > 0)), 3)
    assert {type(recording["t"]), type(recording[["t", "x"]])} == {np.ndarray}
    assert {type(recording["t"].max()), type(np.median(recording["x"]))} == {np.int64, np.float64}
    assert np.shares_memory(recording["t"], recording)
    assert recording["t"].tolist() == whole(range(5))["t"].tolist()
    assert recording.flags.writeable


def test_packets_come_one_by_one_with_the_ticks_they_lie_in(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    sink = Aedat4Recorder(path)
    sink.open([STREAM])
    for tick in (0, 1, 4):
        sink.write(EventPacket(tick, 0, 0, 64, 48, events_of(tick)))
    sink.close()
    found = list(packets(path))
    assert [packet.seq for packet in found] == [0, 1, 2]
    assert [packet.time_base_us for packet in found] == [0, 1000, 4000]
    assert [packet.time_end_us for packet in found] == [1000, 2000, 5000]
    assert {(packet.width, packet.height, packet.camera) for packet in found} == {(64, 48, "eye")}
    assert join_events([packet.events for packet in found]).tobytes() == whole([0, 1, 4]).tobytes()


def test_the_warning_of_packets_comes_once_all_were_read(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    record(path, "lz4", close=False)
    path.write_bytes(path.read_bytes() + b"tail")
    stream = packets(path)
    for _ in range(5):
        next(stream)
    with pytest.warns(TornTailWarning), pytest.raises(StopIteration):
        next(stream)


def test_a_search_for_the_next_packet_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.aedat4"
    ends = record(path, "lz4", close=False)
    data = path.read_bytes()
    bait = compression.MAGIC["lz4"] * 3000
    path.write_bytes(data[: ends[1]] + bait + data[ends[1] :])
    # what looks like a packet is tried so many times and no more
    monkeypatch.setattr(reader, "MAX_TRIES", 5000)
    with pytest.warns(DamagedPacketWarning):
        assert len(read(path)) == 100
    monkeypatch.setattr(reader, "MAX_TRIES", 1000)
    with pytest.warns(TornTailWarning):
        assert len(read(path)) == 20


def test_a_packet_is_found_across_the_edge_of_a_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.aedat4"
    for name in COMPRESSIONS:
        ends = record(path, name, close=False)
        data = path.read_bytes()
        for size in range(4, 24):
            monkeypatch.setattr(reader, "_CHUNK_BYTES", size)
            path.write_bytes(data[: ends[1]] + b"?" * 50 + data[ends[1] :])
            with pytest.warns(DamagedPacketWarning):
                assert len(read(path)) == 100
