"""AEDAT2: the DAVIS's address layout, the wrap at 2^31 us, and what else is in real files."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning, TornTailWarning
from evs.drivers.files.reading import ReadAsWarning
from evs.launch.main import main
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, config={"a": [1]})
HEADER = (
    b"#!AER-DAT2.0\r\n# jAER wrote this\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346blue\r\n"
)


def record(path: Path, events: Events, stream: StreamInfo = STREAM) -> dict[str, object]:
    sink = files.recorder_for(path)
    sink.open([stream])
    ticks = -(-events["t"] // stream.tick_us)
    try:
        for seq, part in enumerate(np.split(events, np.flatnonzero(np.diff(ticks)) + 1)):
            sink.write(EventPacket(seq, 0, 0, stream.width, stream.height, part, stream.camera))
    finally:
        report = sink.close()
    return report


def word(address: int, stamp: int) -> bytes:
    return struct.pack(">Ii", address, stamp)


def pixel(x: int, y: int, p: int, stamp: int) -> bytes:
    """A word of a DAVIS346 at x, y from the upper left, by hand."""
    return word((259 - y) << 22 | (345 - x) << 12 | p << 11, stamp)


def written(path: Path, *words: bytes, header: bytes = HEADER) -> Path:
    path.write_bytes(header + b"".join(words))
    return path


def test_the_bytes_are_the_daviss(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    record(path, make_events([1, 2, 1000], [0, 345, 10], [0, 259, 20], [1, 0, 1]))
    data = path.read_bytes()
    header, _, words = data.partition(b"#End Of ASCII Header\r\n")
    assert header.startswith(b"#!AER-DAT2.0\r\n")
    assert all(line.startswith(b"#") for line in header.split(b"\r\n")[:-1])
    assert words == pixel(0, 0, 1, 1) + pixel(345, 259, 0, 2) + pixel(10, 20, 1, 1000)
    # the first pixel is at the top left, which jAER counts from the lower right
    assert words[:4] == ((259 << 22) | (345 << 12) | (1 << 11)).to_bytes(4, "big")
    assert files.read(path).stream == STREAM


def test_a_recording_is_split_where_the_clock_wraps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.aedat"
    wrap = 1 << 31
    stamps = [wrap - 2, wrap - 1, wrap, wrap + 1, 2 * wrap - 1, 2 * wrap, 5 * wrap + 7]
    events = make_events(stamps, range(7), range(7), [1] * 7)
    stream = StreamInfo(346, 260, tick_us=1 << 40)
    assert record(path, events, stream)["files"] == 4
    parts = [path, *(tmp_path / f"a-00{k}.aedat" for k in (1, 2, 3))]
    assert [files.read(part, single=True)["t"].tolist() for part in parts] == [
        stamps[:2],
        stamps[2:5],
        stamps[5:6],
        stamps[6:],
    ]
    raw = np.frombuffer(parts[1].read_bytes().partition(b"Header\r\n")[2], ">i4")
    assert raw[1::2].tolist() == [0, 1, wrap - 1]
    assert files.read(path)["t"].tolist() == stamps
    assert main(["info", str(path), "--single"]) == 0
    assert f"goes on in  {parts[1]} and 2 more" in capsys.readouterr().out
    # the next recording would mix with those parts
    with pytest.raises(EvsError, match="of an earlier recording would mix"):
        record(path, events, stream)


def test_a_recording_that_begins_late_is_one_file(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    events = make_events([1 << 32, (1 << 32) + 5], [1, 2], [1, 2], [0, 1])
    assert record(path, events)["files"] == 1
    assert files.read(path).tobytes() == events.tobytes()
    assert list(tmp_path.iterdir()) == [path]


def test_what_does_not_fit_is_refused_before_a_byte_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    for width, height in ((1025, 260), (346, 513)):
        sink = files.recorder_for(path)
        with pytest.raises(EvsError, match="AEDAT2 holds at most 1024 x 512 px"):
            sink.open([StreamInfo(width, height)])
        assert not path.exists()
    with pytest.raises(EvsError, match="cannot record an event at -1 us"):
        record(path, make_events([-1], [1], [1], [1]))
    record(path, make_events([0], [1023], [511], [1]), StreamInfo(1024, 512))
    assert files.read(path)[["x", "y"]].tolist() == [(1023, 511)]
    with pytest.raises(EvsError, match="time steps back"):
        record(path, make_events([1 << 31, 5], [1, 1], [1, 1], [1, 1]))


def test_words_of_no_whole_frame_or_sample_are_counted(tmp_path: Path) -> None:
    aps, imu = 1 << 31, 1 << 31 | 0xC00
    words = [pixel(1, 2, 1, 10), word(aps | 5 << 12, 11), word(aps | 0x400, 11), word(imu, 12)]
    words += [word(0x400, 13), pixel(3, 4, 0, 14)]
    path = written(tmp_path / "a.aedat", *words)
    assert files.read(path).tolist() == [(10, 1, 2, 1), (14, 3, 4, 0)]
    found = files.summary(path)
    assert found.left_out == {
        "frames that are not whole": 1,
        "IMU words of no whole sample": 1,
        "external input events": 1,
    }
    assert (found.stream.width, found.stream.height, found.stream.sensor) == (346, 260, "davis346")


@pytest.mark.parametrize("first", [-(1 << 31), 0])
def test_a_wrap_inside_a_real_cameras_file_is_followed(tmp_path: Path, first: int) -> None:
    end = (1 << 31) - 1
    stamps = [end - 5, end, first, first + 7]
    path = written(tmp_path / "a.aedat", *(pixel(1, 1, 1, stamp) for stamp in stamps))
    assert files.read(path)["t"].tolist() == [end - 5, end, end + 1, end + 8]


def test_unsorted_stamps_are_sorted_and_told(tmp_path: Path) -> None:
    stamps = [10, 30, 20, 40, 39, 41]
    path = written(tmp_path / "a.aedat", *(pixel(k, 1, 1, t) for k, t in enumerate(stamps)))
    at = len(HEADER) + 8 * 2
    said = f"2 time stamps ran backwards and were sorted; the first at byte {at}"
    with pytest.warns(BackwardsWarning, match=said):
        events = files.read(path)
    assert events["t"].tolist() == sorted(stamps)
    assert events["x"].tolist() == [0, 2, 1, 4, 3, 5]
    assert files.summary(path).backwards == said


def test_a_clock_that_was_set_anew_stays_so(tmp_path: Path) -> None:
    stamps = [5_000_000, 5_000_010, 3, 9]
    path = written(tmp_path / "a.aedat", *(pixel(1, 1, 1, t) for t in stamps))
    with pytest.warns(BackwardsWarning, match="time begins anew 1 times"):
        assert files.read(path)["t"].tolist() == stamps
    found = files.summary(path)
    assert (found.first_us, found.last_us, found.packets) == (3, 5_000_010, 3)


def test_events_out_of_order_over_many_chunks_are_all_there(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    count = 200_000
    stamps = np.arange(count) * 7 + random.integers(0, 20_000, count)
    words = np.empty((count, 2), ">i4")
    words[:, 0], words[:, 1] = (random.integers(0, 260, count) << 22), stamps
    path = tmp_path / "a.aedat"
    path.write_bytes(HEADER + words.tobytes())
    with pytest.warns(BackwardsWarning):
        events = files.read(path)
    assert events["t"].tolist() == sorted(stamps.tolist())


def test_damaged_words_and_a_torn_tail_are_told_by_their_offset(tmp_path: Path) -> None:
    bad = word(300 << 22, 11)
    path = written(tmp_path / "a.aedat", pixel(1, 1, 1, 10), bad, bad, pixel(2, 2, 1, 12), b"torn")
    at, end = len(HEADER) + 8, len(HEADER) + 32
    with (
        pytest.warns(DamagedPacketWarning, match=f"2 damaged words .* at byte {at}: address 0x4b"),
        pytest.warns(TornTailWarning, match=f"4 bytes at offset {end} "),
    ):
        assert files.read(path)["t"].tolist() == [10, 12]
    assert files.repair(path).cut_bytes == 4
    assert path.stat().st_size == end
    assert not files.repair(path).needed


def test_garbage_behind_the_last_event_is_a_torn_tail(tmp_path: Path) -> None:
    bad = word(300 << 22, 11)
    path = written(tmp_path / "a.aedat", pixel(1, 1, 1, 10), bad * 70_000, b"torn")
    end = len(HEADER) + 8
    with pytest.warns(TornTailWarning, match=f"560004 bytes at offset {end} "):
        assert files.read(path)["t"].tolist() == [10]
    assert files.repair(path).cut_bytes == 560_004
    assert path.read_bytes() == HEADER + pixel(1, 1, 1, 10)
    # where a sound word follows, it is damage in the middle
    written(path, bad * 70_000, pixel(1, 1, 1, 10))
    with pytest.warns(DamagedPacketWarning, match=f"70000 .* at byte {len(HEADER)}: address"):
        assert files.read(path)["t"].tolist() == [10]


def test_a_first_event_that_looks_like_a_comment_is_an_event(tmp_path: Path) -> None:
    # y 140 ... 143 from below: the address begins with the byte of a '#'
    events = make_events(range(1, 5), [9] * 4, [259 - y for y in range(140, 144)], [1] * 4)
    path = tmp_path / "a.aedat"
    record(path, events)
    assert path.read_bytes().partition(b"Header\r\n")[2][:1] == b"#"
    assert files.read(path).tobytes() == events.tobytes()
    other = written(tmp_path / "b.aedat", *(pixel(9, int(e["y"]), 1, int(e["t"])) for e in events))
    assert files.read(other)["y"].tolist() == events["y"].tolist()


Encode = Callable[[int, int, int], int]

JAER, INI = "ch.unizh.ini.jaer.chip.retina", "eu.seebetter.ini.chips.davis"
CHIPS: dict[str, tuple[str, int, int, Encode]] = {
    "davis346": (f"{INI}.Davis346blue", 346, 260, lambda x, y, p: y << 22 | x << 12 | p << 11),
    "davis240": (f"{INI}.DVS240", 240, 180, lambda x, y, p: y << 22 | x << 12 | p << 11),
    "davis208pp": (f"{INI}.Davis208PixelParade", 208, 192,
                   lambda x, y, p: y << 22 | x << 12 | (1 - p) << 11),
    "dvs128": (f"{JAER}.DVS128", 128, 128, lambda x, y, p: y << 8 | x << 1 | 1 - p),
    "tmpdiff128": (f"{JAER}.Tmpdiff128", 128, 128, lambda x, y, p: y << 8 | x << 1 | 1 - p),
    "dvs640": (f"{JAER}.DVS640", 640, 480, lambda x, y, p: y << 11 | x << 1 | p),
    "dvs1280": (f"{JAER}.DVS1280x720SD", 1280, 720, lambda x, y, p: y << 12 | x << 1 | p),
    # these three count from the upper left
    "dvxplorer": (f"{JAER}.DVXplorer", 640, 480,
                  lambda x, y, p: (479 - y) << 22 | (639 - x) << 12 | p << 11),
    "s5krc1s": ("nrv.chip.NRVS5KRC1S", 960, 720,
                lambda x, y, p: p << 20 | (719 - y) << 10 | (959 - x)),
    "imx636": ("prophesee.chip.PropheseeIMX636HD", 1280, 720,
               lambda x, y, p: p << 22 | (719 - y) << 11 | (1279 - x)),
}  # fmt: skip
"""chip -> jAER's class, size, address of a pixel counted from the lower right"""


def events_of(name: str) -> tuple[Events, bytes]:
    """Events that reach every edge of a chip, and their words."""
    _, width, height, encode = CHIPS[name]
    rng = np.random.default_rng(3)
    x, y = rng.integers(0, width, 500), rng.integers(0, height, 500)
    x[:4], y[:4] = (0, width - 1, 0, width - 1), (0, 0, height - 1, height - 1)
    events = make_events(range(500), x, y, rng.integers(0, 2, 500))
    words = (word(encode(width - 1 - x, height - 1 - y, p), t) for t, x, y, p in events.tolist())
    return events, b"".join(words)


@pytest.mark.parametrize("name", CHIPS)
def test_each_chip_of_jaer_has_a_layout_of_its_own(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    title, width, height, _ = CHIPS[name]
    events, words = events_of(name)
    stated = written(
        tmp_path / "a.aedat", words, header=f"#!AER-DAT2.0\r\n# AEChip: {title}\r\n".encode()
    )
    found = files.read(stated)
    assert found.tobytes() == events.tobytes()
    assert (found.stream.width, found.stream.height) == (width, height)
    assert not files.summary(stated).read_as
    # the same without that line, by what the caller knows
    bare = written(tmp_path / "b.aedat", words, header=b"#!AER-DAT2.0\r\n")
    assert files.read(bare, chip=name).tobytes() == events.tobytes()
    assert main(["info", str(bare), "--chip", name, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stream"]["width"] == width


@pytest.mark.parametrize(
    ("name", "file", "header", "chip"),
    [
        ("dvs128", "a.aedat", b"", "dvs128"),
        ("davis240", "a.aedat", b"", "davis240"),
        ("davis346", "a.aedat", b"", "davis346"),
        # jAER's names of files begin with the chip
        ("dvs1280", "DVS1280x720SD-2024-05-01T10-00-00.aedat", b"", "dvs1280"),
        ("tmpdiff128", "Tmpdiff128-2006-02-14T07-53-37-0800-0 walking.dat", b"", "dvs128"),
        ("dvs640", "a.aedat", b"# created by AEDat2Output in v2e (see ...)\r\n", "dvs640"),
        ("davis346", "a.aedat", b"# created by AEDat2Output in v2e (see ...)\r\n", "davis346"),
        # nothing decides
        ("dvs640", "a.aedat", b"", ""),
        ("dvxplorer", "a.aedat", b"", ""),
        ("dvxplorer", "a.aedat", b"# AEChip: ch.unizh.ini.jaer.chip.cochlea.CochleaAMS1c\r\n", ""),
        ("dvs128", "a.aedat", b"# AEChip: ch.unizh.jaer.stereopsis.DVS128StereoPair\r\n", ""),
    ],
)
def test_the_chip_is_found_by_evidence_or_the_file_is_refused(
    tmp_path: Path, name: str, file: str, header: bytes, chip: str
) -> None:
    events, words = events_of(name)
    path = written(tmp_path / file, words, header=b"#!AER-DAT2.0\r\n" + header)
    if not chip:
        with pytest.raises(EvsError, match=r"--chip"):
            files.read(path)
        return
    with pytest.warns(ReadAsWarning, match=f"is read as {chip}, since "):
        assert files.read(path).tobytes() == events.tobytes()
    assert files.summary(path).read_as.startswith(f"{chip}, since ")


def test_a_davis_with_events_in_a_corner_is_refused(tmp_path: Path) -> None:
    for x, y in ((239, 90), (120, 179), (300, 200), (400, 300)):
        path = written(tmp_path / "a.aedat", word(y << 22 | x << 12, 1), header=b"#!AER-DAT2.0\r\n")
        with pytest.raises(EvsError, match="fit several: add --chip NAME, one of davis346"):
            files.read(path)
        assert len(files.read(path, chip="davis640")) == 1
    record(path, make_events([1], [1], [1], [1]))
    with pytest.raises(EvsError, match="evs recorded it: leave --chip out"):
        files.read(path, chip="davis346")
    with pytest.raises(EvsError, match="chip 'davis345' are not known; there are davis346"):
        files.read(written(path, header=b"#!AER-DAT2.0\r\n"), chip="davis345")


def test_words_of_the_external_input_are_counted(tmp_path: Path) -> None:
    header = b"#!AER-DAT2.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n"
    words = [word(7 << 8 | 3 << 1, 5), word(127 << 8 | 127 << 1 | 1, 6), word(0x8000, 7)]
    path = written(tmp_path / "a.aedat", *words, header=header)
    assert files.read(path).tolist() == [(5, 124, 120, 1), (6, 0, 0, 0)]
    assert files.summary(path).left_out == {"sync words": 1}


def test_only_the_chips_own_line_names_the_camera(tmp_path: Path) -> None:
    # jAER writes its preferences behind it, those of other cameras too
    header = (
        b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
        b'#  <node name="davis"><entry key="Davis346blue.ADC" value="true"/></node>\r\n'
        b'#  <entry key="ch.unizh.ini.jaer.chip.retina.DVS128.size" value="1"/>\r\n'
    )
    path = written(tmp_path / "a.aedat", word(179 << 22 | 239 << 12 | 1 << 11, 5), header=header)
    events = files.read(path)
    assert (events.stream.width, events.stream.height) == (240, 180)
    assert events.tolist() == [(5, 0, 0, 1)]
    assert events.stream.sensor == "davis240"


def test_damaged_headers_and_other_files_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    for data in (
        b"",
        b"#!AER-DAT2\x00.0\r\n12345678",
        b"#!AER-DAT2.0",
        b"nothing",
    ):
        path.write_bytes(data)
        with pytest.raises(EvsError, match=r"is not a readable AEDAT2? file"):
            files.read(path)


def test_the_first_bytes_say_which_aedat_it_is(tmp_path: Path) -> None:
    events = make_events([1, 2], [3, 4], [5, 6], [1, 0])
    for name, kind in (("a.aedat4", "aedat4"), ("a.aedat3", "aedat3"), ("a.aedat2", "aedat2")):
        record(tmp_path / name, events)
        (tmp_path / name).rename(tmp_path / "b.aedat")
        assert files.summary(tmp_path / "b.aedat").format == kind
        assert files.read(tmp_path / "b.aedat").tobytes() == events.tobytes()
