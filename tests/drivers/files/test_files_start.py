"""Streams that begin at a Unix time: every format holds them, also for other readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files import formats
from evs.drivers.files.raw import header_bytes
from evs.drivers.files.recording_file import by_tick
from evs.drivers.ros2.event_messages import EventMessageBuilder, check_start
from evs.launch.main import main
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events
from evs.msgs.codecs import LAST_ROS_US, PAYLOADS, TIME_ORIGIN_US, PayloadReader, decode_evt3

UNIX_US = 1_795_305_600_000_000


def stream_of(start_us: int) -> StreamInfo:
    return StreamInfo(64, 48, config={"scene": {"start_us": start_us}})


def events_from(start_us: int) -> Events:
    """Over the wraps of 64 us, of 4096 us and of 16.8 s counters."""
    after = np.array([0, 1, 63, 64, 4095, 4096, 2**24 - 1, 2**24, 20_000_000, 40_000_000])
    return make_events(start_us + after, np.arange(10), np.arange(10), np.arange(10) % 2)


def recorded(path: Path, stream: StreamInfo, events: Events) -> Events:
    sink = formats.to_write(str(path)).record(path)
    sink.open([stream])
    try:
        for place, event in enumerate(events):
            t_us = int(event["t"])
            sink.write(EventPacket(place, t_us - 1, t_us, 64, 48, events[place : place + 1]))
    finally:
        sink.close()
    return files.read(path)


@pytest.mark.parametrize("kind", formats.RECORDED, ids=lambda kind: kind.name)
@pytest.mark.parametrize("start_us", [0, 2**31, UNIX_US])
def test_every_format_holds_it(kind: formats.Format, start_us: int, tmp_path: Path) -> None:
    events, path = events_from(start_us), tmp_path / f"run{kind.suffixes[0]}"
    assert np.array_equal(recorded(path, stream_of(start_us), events), events)
    # and what it is converted to
    other = tmp_path / "other.csv"
    files.convert(path, other, events_only=True)
    assert np.array_equal(files.read(other), events)


@pytest.mark.parametrize("start_us", [0, UNIX_US])
def test_the_clock_of_a_raw_file_begins_at_zero(start_us: int, tmp_path: Path) -> None:
    path = tmp_path / "run.raw"
    recorded(path, stream_of(start_us), events_from(start_us))
    head, _, words = path.read_bytes().partition(b"% end\n")
    assert f"% evs_time_origin_us {-start_us}\n" in head.decode()
    # TIME_HIGH 0 first: readers that shift stamps to the first word shift by nothing
    assert words[:2] == b"\x00\x80"
    decoded, _ = decode_evt3(words, time_origin_us=0)
    assert decoded["t"].tolist() == (events_from(start_us)["t"] - start_us).tolist()


def test_the_order_of_evt21_has_a_line_of_its_own() -> None:
    # as OpenEB writes it; readers of the other order refuse the file by it
    for version in ("2.0", "2.1", "3.0"):
        head = header_bytes(stream_of(0), version, 0)
        assert (b"% endianness little\n" in head) == (version == "2.1")


SHIFTED = {
    "run.raw": "",
    "run.evt2": "",
    "run.evt21": "",
    "run.dat": "",
    "run.mcap": "",
    "run.db3": "",
    "run.bag": "evt3",
}
KEPT = {
    "a.mcap": "libcaer",
    "b.mcap": "mono",
    "c.db3": "dvs",
    "d.bag": "",
    "e.csv": "",
    "f.h5": "",
    "g.hdf5": "",
}


@pytest.mark.parametrize("name", SHIFTED | KEPT)
def test_convert_shifts_the_start_only_where_the_stamps_do_not_fit(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events, source, target = events_from(UNIX_US), tmp_path / "source.npz", tmp_path / name
    # as another camera's recording: nothing says where it begins
    np.savez(source, **{field: events[field] for field in "txyp"}, sensor_size=(64, 48))
    encoding = (SHIFTED | KEPT)[name]
    options = ["--encoding", encoding] if encoding else []
    assert main(["convert", str(source), str(target), *options]) == 0
    told = capsys.readouterr().out
    assert files.read(target).tobytes() == events.tobytes()
    assert main(["convert", str(target), str(tmp_path / "back.csv"), "--quiet"]) == 0
    assert files.read(tmp_path / "back.csv").tobytes() == events.tobytes()
    start_us = UNIX_US - 1000
    line = f"start: its clock begins at {start_us} us; its header holds this offset\n"
    assert (line in told) == (name in SHIFTED)
    assert files.stream_of(target).start_us == (start_us if name in SHIFTED else 0)
    # without it, what has to be shifted is refused in a line, and what was there stays
    again = main(
        ["convert", str(source), str(target), *options, "--start", "keep", "--quiet", "--force"]
    )
    assert again == (2 if name in SHIFTED else 0)
    if name in SHIFTED:
        assert "leave --start keep out" in capsys.readouterr().err
    assert files.read(target).tobytes() == events.tobytes()


def test_a_format_that_cannot_tell_a_time_refuses_it_without_its_begin(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"EVT3 holds 0 \.\.\. \d+ us, \.aedat4 any time"):
        recorded(tmp_path / "run.raw", StreamInfo(64, 48), events_from(UNIX_US))
    late = LAST_ROS_US - 1_000_000
    with pytest.raises(EvsError, match=f"rosbag2 holds {late} ... {LAST_ROS_US} us"):
        recorded(tmp_path / "run.mcap", stream_of(late), events_from(late))


@pytest.mark.parametrize("encoding", PAYLOADS)
def test_messages_of_ros_hold_it(encoding: str) -> None:
    events = events_from(UNIX_US)
    builder = EventMessageBuilder(encoding, 0.0, 1_000_000, UNIX_US)
    reader = PayloadReader(encoding, time_origin_us=TIME_ORIGIN_US - UNIX_US)
    found = []
    for place in range(len(events)):
        t_us = int(events["t"][place])
        packet = EventPacket(place, t_us - 1, t_us, 64, 48, events[place : place + 1])
        found += [reader.events(m.data, m.time_base_ns) for m in builder.add(packet)]
    assert np.array_equal(np.concatenate(found), events)


def test_ros_has_no_time_after_january_2038() -> None:
    check_start(LAST_ROS_US, "eye")
    with pytest.raises(EvsError, match="ROS's time ends"):
        check_start(LAST_ROS_US + 1, "eye")


@pytest.mark.parametrize("said", [None, "soon", -1, 1 << 60, True, 1.5])
def test_a_begin_that_cannot_be_is_none(said: object) -> None:
    assert StreamInfo(1, 1, config={"scene": {"start_us": said}}).start_us == 0
    assert StreamInfo(1, 1, config={"scene": said}).start_us == 0


@pytest.mark.parametrize("kind", formats.RECORDED, ids=lambda kind: kind.name)
@pytest.mark.parametrize("start_us", [0, 352, 2**31 - 4000])
def test_ticks_are_counted_from_the_start(
    kind: formats.Format, start_us: int, tmp_path: Path
) -> None:
    # 50 ticks with 20 events each, from the first us of a tick to its last
    t = start_us + 1 + np.arange(1000) * 999 // 19 % 1000 + np.arange(1000) // 20 * 1000
    events = make_events(np.sort(t), np.arange(1000) % 64, np.arange(1000) % 48, t % 2)
    path, stream = tmp_path / f"run{kind.suffixes[0]}", stream_of(start_us)
    sink = formats.to_write(str(path)).record(path)
    sink.open([stream])
    for place, part in enumerate(by_tick(events, stream)):
        begin_us = start_us + 1000 * place
        sink.write(EventPacket(place, begin_us, begin_us + 1000, 64, 48, part))
    sink.close()
    packets = list(files.packets(path))
    assert sum(len(packet) for packet in packets) == 1000
    # a packet that began before the end of the last would look like another run
    ends = [packet.time_end_us for packet in packets]
    assert all(p.time_base_us >= end for p, end in zip(packets[1:], ends, strict=False))
