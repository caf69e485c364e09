"""CSV and TXT: what we write, what others write, and the metadata file beside them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning, TornTailWarning
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, config={"a": [1]})
WANTED = [(5, 1, 2, 1), (7, 3, 4, 0)]


def test_the_text_is_what_anybody_reads(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    sink = files.recorder_for(path)
    sink.open([STREAM])
    big = (1 << 62) - 1
    events = make_events([-5, 6, big], [1, 2, 345], [3, 4, 259], [1, 0, 1])
    sink.write(EventPacket(0, 0, 1, 346, 260, events, "eye"))
    sink.close()
    lines = path.read_text().split("\n")
    assert lines == ["t,x,y,p", "-5,1,3,1", "6,2,4,0", f"{big},345,259,1", ""]
    assert files.read(path).tobytes() == events.tobytes()
    assert files.read(path).stream == STREAM
    columns: Any = np.genfromtxt(path, np.int64, delimiter=",", names=True)
    assert columns.dtype.names == ("t", "x", "y", "p")
    assert columns["t"].tolist() == [-5, 6, big]


def recorded(path: Path, events: Events, kind: str | None = None) -> None:
    sink = files.recorder_for(path, kind=kind)
    sink.open([STREAM])
    try:
        sink.write(EventPacket(0, 0, 1, 346, 260, events, "eye"))
    finally:
        sink.close()


LAST = 2**33 * 1_000_000 - 1
SOME = make_events([0, 6, 3_000_000, LAST], [1, 2, 345, 5], [3, 4, 259, 6], [1, 0, 1, 0])


def test_txt_is_that_of_the_event_camera_dataset(tmp_path: Path) -> None:
    path = tmp_path / "events.txt"
    recorded(path, SOME)
    assert path.read_text().split("\n") == [
        "0.000000 1 3 1",
        "0.000006 2 4 0",
        "3.000000 345 259 1",
        "8589934591.999999 5 6 0",
        "",
    ]
    recording = files.read(path)
    assert recording.tobytes() == SOME.tobytes()
    assert recording.stream == STREAM
    assert files.summary(path).format == "txt"
    table = np.loadtxt(path)
    assert np.rint(table[:, 0] * 1e6).astype(np.int64).tolist() == SOME["t"].tolist()
    assert table[:, 1:].astype(int).tolist() == [[1, 3, 1], [2, 4, 0], [345, 259, 1], [5, 6, 0]]


def test_e2vids_txt_begins_with_the_size(tmp_path: Path) -> None:
    path = tmp_path / "events.txt"
    recorded(path, SOME, "e2vid")
    # as rpg_e2vid reads it: width and height, then rows from the second line on
    assert path.read_text().partition("\n")[0] == "346 260"
    table = np.loadtxt(path, skiprows=1)
    assert table[:, 1].tolist() == [1, 2, 345, 5]
    (tmp_path / "events.txt.json").unlink()
    recording = files.read(path)
    assert recording.tobytes() == SOME.tobytes()
    assert (recording.stream.width, recording.stream.height) == (346, 260)
    assert files.summary(path).format == "e2vid"


def test_txt_refuses_times_that_its_seconds_cannot_resolve(tmp_path: Path) -> None:
    for t in (-1, LAST + 1):
        with pytest.raises(EvsError, match=f"TXT holds 0 ... {LAST} us, .aedat4 any time"):
            recorded(tmp_path / "a.txt", make_events([t], [1], [2], [1]))


@pytest.mark.parametrize("name", ["a.csv", "a.txt"])
def test_without_its_metadata_file_a_recording_is_read(tmp_path: Path, name: str) -> None:
    path, beside = tmp_path / name, tmp_path / f"{name}.json"
    recorded(path, SOME)
    assert json.loads(beside.read_text())["config"] == STREAM.config
    for damage in ("{", "[]", "", '{"width": "346"}'):
        beside.write_text(damage)
        assert files.read(path).tobytes() == SOME.tobytes()
    beside.unlink()
    recording = files.read(path)
    assert recording.tobytes() == SOME.tobytes()
    stream = recording.stream
    assert (stream.width, stream.height, stream.sensor) == (346, 260, "unknown")
    # neither a folder nor a pipe of that name is read
    beside.mkdir()
    assert len(files.read(path)) == 4
    beside.rmdir()
    os.mkfifo(beside)
    assert len(files.read(path)) == 4


def test_only_metadata_of_a_recording_is_replaced(tmp_path: Path) -> None:
    path, beside = tmp_path / "a.csv", tmp_path / "a.csv.json"
    beside.write_text('{"mine": 1}')
    with pytest.raises(EvsError, match=r"a\.csv\.json would be replaced .* choose another name"):
        recorded(path, SOME)
    source = tmp_path / "source.aedat4"
    recorded(source, SOME)
    with pytest.raises(EvsError, match=r"a\.csv\.json would be replaced"):
        files.convert(source, path)
    assert beside.read_text() == '{"mine": 1}'
    beside.unlink()
    for seed in (9, 9):
        done = files.convert(source, path)
        assert done.files == [path]
        assert files.stream_of(path).seed == seed
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.csv", "a.csv.json", source.name]


def test_a_device_has_no_metadata_file(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Path] = []
    monkeypatch.setattr(
        "evs.drivers.files.csv.write_metadata", lambda path, _: written.append(path)
    )
    recorded(Path("/dev/null"), SOME, "csv")
    assert written == []


@pytest.mark.parametrize(
    "text",
    [
        "5,1,2,1\n7,3,4,0\n",
        "5,1,2,1\n7,3,4,0",
        "t,x,y,p\r\n5,1,2,1\r\n7,3,4,0\r\n",
        "x,y,polarity,timestamp\n1,2,1,5\n3,4,-1,7\n",
        '"x";"y";"p";"t"\n1;2;1;5\n3;4;0;7\n',
        "5 1 2 1\n7 3 4 0\n",
        "  5   1\t2 1\n7 3 4 0\n",
        "5\t1\t2\t1\n7\t3\t4\t0\n",
        "# made by hand\n0.000005 1 2 1\n0.000007 3 4 0\n",
        "t,x,y,p\n5e-6,1,2,1\n7e-6,3,4,0\n",
        "t,x,y,on\n5,1,2,True\n7,3,4,False\n",
        "t,x,y,p,cause\n5,1,2,1,9\n7,3,4,0,8\n",
        "\n\n5,1,2,1\n\n# a word\n7,3,4,0\n",
        "5,1.0,2.0,1.0\n7,3.0,4.0,0.0\n",
        "5.000e+00 1.000e+00 2.000e+00 1.000e+00\n7.000e+00 3.000e+00 4.000e+00 0.000e+00\n",
        "t_us,x,y,p\n5.1,1,2,1\n7.9,3,4,0\n",
        "p,y,x,t_s\n1,2,1,0.000005\n0,4,3,0.000007\n",
        "4 5\n0.000005000 1 2 1\n0.000007000 3 4 0\n",
        "0.000005000 1 2 1\n0.000007000 3 4 -1\n",
    ],
)
def test_what_others_write_is_read(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    events = files.read(path)
    assert events.tolist() == WANTED
    assert (events.stream.width, events.stream.height) == (4, 5)


def test_a_stream_without_ticks_is_read_in_parts_of_a_ms(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{t},1,1,1\n" for t in range(1, 5001)))
    path.with_name("a.csv.json").write_text('{"width": 9, "height": 9, "tick_us": 1}')
    assert [len(packet) for packet in files.packets(path)] == [1000] * 5


def test_lines_that_are_no_events_are_told_by_their_offset(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    good = "5,1,2,1\n"
    for bad in ("1,2,3", "1,2,3,4,5", "a,b,c,d", "1,,2,1", "nan,1,1,1", "1_0,1,1,1", "9" * 5000):
        path.write_text(f"{good}{bad}\n7,3,4,0\n")
        with pytest.warns(DamagedPacketWarning, match=f"1 damaged lines .* at byte {len(good)}"):
            assert files.read(path).tolist() == WANTED
        path.write_text(f"{good}7,3,4,0\n{bad}")
        with pytest.warns(TornTailWarning, match=f"{len(bad)} bytes at offset 16 "):
            assert files.read(path).tolist() == WANTED
        assert files.repair(path).cut_bytes == len(bad)
    for row in ("5,40000,2,1", "5,-1,2,1", f"{1 << 63},1,1,1", f"-{1 << 70},1,1,1"):
        path.write_text(f"{good}{row}\n7,3,4,0\n")
        with pytest.warns(DamagedPacketWarning, match="1 damaged lines .* at byte 8: an event at"):
            assert files.read(path).tolist() == WANTED


def test_offsets_hold_where_lines_end_as_in_windows(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"t,x,y,p\r\n5,1,2,1\r\n5,-1,2,1\r\n7,3,4,0\r\n6,1,2,1\r\n")
    with (
        pytest.warns(DamagedPacketWarning, match="at byte 18: an event"),
        pytest.warns(BackwardsWarning, match="the first at byte 37"),
    ):
        assert files.read(path)["t"].tolist() == [5, 6, 7]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,x,y\n1,2,3\n", "needs columns t, x, y, p"),
        ("hello\n", "its first line is 'hello'"),
        ("1,2,3\n", "a line has 3 columns"),
        ("346 260\n346 260\n", "a line has 2 columns"),
        ("t,n,x,y,p\n1,2,3,1\n", "a line has 4 columns; it needs 5: t, x, y, p"),
    ],
)
def test_other_text_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(EvsError, match=said):
        files.read(path)


def test_a_line_without_end_is_damage_and_not_a_flood(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("5,1,2,1\n" + "1" * 6_000_000 + "\n7,3,4,0\n")
    with pytest.warns(DamagedPacketWarning):
        assert files.read(path).tolist() == WANTED


def test_an_empty_file_has_no_events(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for text in ("", "t,x,y,p\n", "# nothing\n"):
        path.write_text(text)
        assert len(files.read(path)) == 0


KILLED = [("csv", kept) for kept in ("7", "7,1", "7,1,1", "7,1,1\r")]
KILLED += [(kind, kept) for kind in ("txt", "e2vid") for kept in ("0", "0.0", "0.5 1", "0.5 1 1")]


def test_a_torn_event_may_lack_named_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,n,x,y,p\n7,1")
    with pytest.warns(TornTailWarning):
        assert len(files.read(path)) == 0


@pytest.mark.parametrize(("kind", "kept"), KILLED)
def test_a_recorder_killed_in_its_first_event_leaves_a_file_without_events(
    tmp_path: Path, kind: str, kept: str
) -> None:
    path = tmp_path / f"a.{kind}"
    sink = files.recorder_for(path)
    sink.open([StreamInfo(9, 9)])
    sink.close()
    whole = path.read_bytes()
    path.write_bytes(whole + kept.encode())
    with pytest.warns(TornTailWarning):
        assert len(files.read(path)) == 0
    assert files.repair(path).cut_bytes == len(kept)
    assert path.read_bytes() == whole
