"""RAW, DAT, HDF5 and bags: headers of real cameras, what does not fit, disorder, missing extras."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning
from evs.drivers.sink import Sink
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events
from evs.msgs.codecs import encode_evt2, encode_evt3

NAMES = {
    "evt3": "a.raw",
    "evt2": "a.raw",
    "evt21": "a.raw",
    "dat": "a.dat",
    "hdf5": "a.h5",
    "metavision": "a.hdf5",
    "rosbag1": "a.bag",
    "rosbag2": "a.mcap",
}
FOUR = make_events([1, 5, 900, 2500], [0, 63, 5, 6], [0, 47, 5, 6], [1, 0, 1, 0])
HEADERS = {
    "evk4": b"% camera_integrator_name Prophesee\n% date 2023-03-29 16:37:46\n% evt 3.0\n% format "
    b"EVT3;height=720;width=1280\n% generation 4.2\n% geometry 1280x720\n% end\n",
    "old": b"% Date 2014-02-28 13:37:42\n% evt 3.0\n% Height: 720\n% Width: 1280\n",
    "geometry": b"% evt 3.0\n% geometry 1280x720\n% end\n",
    "generation": b"% evt 3.0\n% sensor_generation 4.1\n% end\n",
    "odd": b"% format EVT3;height=720;width=1280\n% \xff\xfe\n%\n% geometry 0x0\n% end\n",
}


def opened(path: Path, kind: str, stream: StreamInfo, **options: str) -> Sink:
    sink = files.recorder_for(path, kind=kind, **options)
    sink.open([stream])
    return sink


def packet(events: Events, stream: StreamInfo) -> EventPacket:
    return EventPacket(0, 0, 0, stream.width, stream.height, events)


@pytest.mark.parametrize("name", HEADERS)
def test_headers_of_real_cameras(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(HEADERS[name] + encode_evt3(FOUR, time_origin_us=0))
    recording = files.read(path)
    assert recording.tobytes() == FOUR.tobytes()
    stream = recording.stream
    assert (stream.width, stream.height, stream.sensor) == (1280, 720, "unknown")
    assert files.summary(path).format == "evt3"


def test_a_header_without_a_size_gives_what_the_events_need(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(b"% evt 2.0\n% end\n" + encode_evt2(FOUR, time_origin_us=0))
    recording = files.read(path)
    assert recording.tobytes() == FOUR.tobytes()
    assert (recording.stream.width, recording.stream.height) == (64, 48)
    assert files.summary(path).format == "evt2"


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "does not name its EVT"),
        (b"\x00\x80\x05\x60", "does not name its EVT"),
        (b"% evt 4.0\n% end\n", "is EVT4 in its header, which OpenEB's .*; EVT 2.0, 2.1 and 3.0"),
        (b"% evt 5.0\n% end\n", "is 'EVT 5.0' in its header; EVT 2.0, 2.1 and 3.0 are read"),
        (b"% format EVT4;height=320;width=320\n% end\n", "is EVT4 in its header, which"),
        (b"% format AER-8b;height=320;width=320\n% end\n", "is AER-8b in its header, addresses"),
        (b"% format HISTO3D\n% evt 3.0\n% end\n", "is HISTO3D in its header, histograms"),
        (b"% system_ID 999\n% end\n", "does not name its EVT in its header, nor a system_ID"),
        (b"% integrator_name Other\n% system_ID 21\n% end\n", "does not name its EVT"),
        (b"% evt 3.0\n% end\n", "neither gives the size"),
        (b"% evt 3.0\n", "neither gives the size"),
    ],
)
def test_what_is_no_raw_file_is_refused(data: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(data)
    with pytest.raises(EvsError, match=says):
        files.read(path)


@pytest.mark.parametrize("kind", NAMES)
def test_other_bytes_are_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    path = tmp_path / NAMES[kind]
    for data in (b"", b"garbage\n" * 100, bytes(5000)):
        path.write_bytes(data)
        with pytest.raises(EvsError) as error:
            files.read(path)
        assert "\n" not in str(error.value)
        assert str(path) in str(error.value)
    with pytest.raises(EvsError, match="no file"):
        files.read(tmp_path / f"none{path.suffix}")


def test_pixels_outside_of_the_sensor_and_unsorted_stamps(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    late = make_events([3000], [4], [4], [1])
    data = encode_evt3(late, time_origin_us=0) + encode_evt3(FOUR, time_origin_us=0)
    path.write_bytes(b"% format EVT3;height=48;width=60\n% end\n" + data)
    with pytest.warns() as caught:
        recording = files.read(path)
    assert [each.category for each in caught] == [DamagedPacketWarning, BackwardsWarning]
    assert "1 damaged events were left out, the first at byte 39: outside of 60 x 48 px" in str(
        caught[0].message
    )
    assert "3 time stamps ran backwards and were sorted" in str(caught[1].message)
    assert recording["t"].tolist() == [1, 900, 2500, 3000]
    assert recording["x"].tolist() == [0, 5, 6, 4]


@pytest.mark.parametrize(
    ("kind", "sides", "says"),
    [
        ("evt3", (2049, 10), "EVT3 holds at most 2048 x 2048 px, .aedat4 any size"),
        ("evt2", (10, 2049), "EVT2 holds at most 2048 x 2048 px"),
        ("dat", (16384, 10), "DAT holds at most 16383 x 16383 px"),
        ("rosbag2", (32768, 0), "at most 32768 x 32768"),
    ],
)
def test_sensors_that_are_too_large_are_refused_before_writing(
    kind: str, sides: tuple[int, int], says: str, tmp_path: Path
) -> None:
    path = tmp_path / NAMES[kind]
    with pytest.raises(EvsError, match=says):
        opened(path, kind, StreamInfo(*sides))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [kind for kind in NAMES if kind != "hdf5"])
def test_negative_time_is_refused(kind: str, tmp_path: Path) -> None:
    stream = StreamInfo(64, 48)
    sink = opened(tmp_path / NAMES[kind], kind, stream)
    with pytest.raises(EvsError, match=r"cannot record an event at -5 us .* \.aedat4 any time"):
        sink.write(packet(make_events([-5], [0], [0], [0]), stream))
    sink.write(packet(FOUR, stream))
    assert sink.close()["events"] == 4
    assert files.read(tmp_path / NAMES[kind]).tobytes() == FOUR.tobytes()


@pytest.mark.parametrize("kind", NAMES)
def test_steps_back_in_time_are_refused_and_the_rest_is_kept(kind: str, tmp_path: Path) -> None:
    stream = StreamInfo(64, 48)
    sink = opened(tmp_path / NAMES[kind], kind, stream)
    sink.write(packet(FOUR, stream))
    with pytest.raises(EvsError, match="no way back in time; record to"):
        sink.write(packet(FOUR, stream))
    sink.close()
    assert files.read(tmp_path / NAMES[kind]).tobytes() == FOUR.tobytes()


@pytest.mark.parametrize("name", ["a.h5", "a.hdf5"])
def test_the_index_of_a_long_pause_is_small_and_right(name: str, tmp_path: Path) -> None:
    import h5py

    path = tmp_path / name
    sink = files.recorder_for(path)
    sink.open([StreamInfo(64, 48)])
    t = np.array([5, 900, 2_500, 2_000_000_123, 2_000_000_124, 2_000_900_000, 4_000_000_000])
    for seq, stamps in enumerate((t[:2], t[2:5], t[5:])):
        events = make_events(stamps, stamps % 64, stamps % 48, stamps % 2)
        sink.write(EventPacket(seq, 0, int(stamps[-1]), 64, 48, events))
    sink.close()
    # 8 bytes every ms, or 16 every 2 ms without compression, would be 32 MB
    assert path.stat().st_size < (400_000 if name == "a.h5" else 33_000_000)
    assert files.read(path)["t"].tolist() == t.tolist()
    if name == "a.hdf5":
        sink = files.recorder_for(tmp_path / "b.hdf5")
        sink.open([StreamInfo(64, 48)])
        far = make_events([5, 100_000_000_000], [1, 2], [1, 2], [1, 0])
        with pytest.raises(EvsError, match=r"a pause of 100000 s .* 800 MB; record to \.h5"):
            sink.write(EventPacket(0, 0, 1, 64, 48, far))
        sink.close()
    with h5py.File(path) as file:
        if name == "a.h5":
            ms = np.arange(int(t[-1]) // 1000 + 1)
            assert np.array_equal(file["ms_to_idx"][()], np.searchsorted(t, ms * 1000))
            return
        index = file["CD/indexes"][()]
    # of the last slot of 2 ms before that had events: its first event
    slots = (t - t[0]) // 2000
    first = np.flatnonzero(np.diff(slots, prepend=-1))
    before = np.searchsorted(slots[first], np.arange(len(index)), side="left") - 1
    assert index["id"].tolist() == np.where(before < 0, 0, first[before]).tolist()
    assert index["ts"].tolist() == np.where(before < 0, -1, (t - t[0])[first[before]]).tolist()


def test_hours_of_silence(tmp_path: Path) -> None:
    stream = StreamInfo(64, 48)
    hours = make_events([10**10, 15 * 10**9, 2 * 10**10], [0, 1, 2], [0, 1, 2], [0, 1, 0])
    for kind, name in NAMES.items():
        sink = opened(tmp_path / name, kind, stream)
        if kind == "dat":
            with pytest.raises(EvsError, match="an event every 4294 s"):
                sink.write(packet(hours, stream))
            sink.close()
            continue
        for k in range(3):
            sink.write(packet(hours[k : k + 1], stream))
        sink.close()
        assert files.read(tmp_path / name).tobytes() == hours.tobytes()


@pytest.mark.parametrize(
    ("kind", "encoding", "says"),
    [
        ("rosbag2", "evt4", "no encoding 'evt4'; there is: evt3, "),
        ("rosbag1", "evt3", "EVT3 holds 2048 x 2048; set encoding = libcaer"),
    ],
)
def test_encodings_of_bags_that_do_not_work(
    kind: str, encoding: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(EvsError, match=says):
        opened(tmp_path / NAMES[kind], kind, StreamInfo(3000, 10), encoding=encoding)
    assert list(tmp_path.iterdir()) == []
    # a large sensor has its own usual encoding
    stream = StreamInfo(3000, 10)
    sink = opened(tmp_path / NAMES[kind], kind, stream)
    events = make_events([5], [2999], [9], [1])
    sink.write(packet(events, stream))
    sink.close()
    assert files.read(tmp_path / NAMES[kind]).tobytes() == events.tobytes()


@pytest.mark.parametrize(
    ("kind", "library", "extra"),
    [
        ("hdf5", "h5py", "formats"),
        ("rosbag1", "rosbags.rosbag1", "ros2"),
        ("rosbag2", "rosbags.rosbag1", "ros2"),
    ],
)
def test_a_missing_extra_is_one_line(
    kind: str, library: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / NAMES[kind]
    with pytest.raises(EvsError, match=rf"pip install 'evs\[{extra}\]'"):
        files.recorder_for(path)
    path.write_bytes(b"x")
    with pytest.raises(EvsError, match=rf"pip install 'evs\[{extra}\]'"):
        files.read(path)


@pytest.mark.parametrize("row", files.RECORDED, ids=lambda row: row.name)
@pytest.mark.parametrize(
    ("name", "streams", "says"),
    [
        ("a", [], "exactly one camera, got 0"),
        ("a", [StreamInfo(8, 8, "eye"), StreamInfo(1, 1, "two")], r"got 2 \(eye, two\)"),
        ("a", [StreamInfo(346, 0)], "cannot record 346 x 0 px"),
        ("none/a", [StreamInfo(8, 8)], "there is no folder .*mkdir -p"),
        ("folder", [StreamInfo(8, 8)], "it is a folder"),
        ("x" * 300, [StreamInfo(8, 8)], "File name too long"),
    ],
    ids=("none", "two", "flat", "nowhere", "folder", "too long"),
)
def test_what_cannot_be_recorded_is_refused_in_one_line(
    row: files.Format, name: str, streams: list[StreamInfo], says: str, tmp_path: Path
) -> None:
    (tmp_path / f"folder{row.suffixes[0]}").mkdir()
    path = tmp_path / f"{name}{row.suffixes[0]}"
    sink = files.recorder_for(path, kind=row.name)
    with pytest.raises(EvsError, match=says) as caught:
        sink.open(streams)
    assert "\n" not in str(caught.value)
    assert sink.close().get("events", 0) == 0
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("kind", NAMES)
def test_a_file_that_is_there_is_replaced_when_all_is_well(kind: str, tmp_path: Path) -> None:
    path, stream = tmp_path / NAMES[kind], StreamInfo(64, 48)
    path.write_bytes(b"something else")
    sink = opened(path, kind, stream)
    sink.write(packet(FOUR, stream))
    sink.close()
    with pytest.raises(EvsError):
        sink.write(packet(FOUR, stream))
    assert files.read(path).tobytes() == FOUR.tobytes()
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_an_hdf5_file_that_states_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in "txyp":
            file.create_dataset(f"events/{name}", (1 << 40,), "u2", chunks=(1 << 16,))
    with pytest.raises(EvsError, match="cannot be in it"):
        files.read(path)
    with h5py.File(path, "w") as file:
        file["events/t"], file["events/x"] = [1, 2], [1, 2]
    with pytest.raises(EvsError, match="it needs columns t, x, y, p in one of events"):
        files.read(path)


def test_the_text_of_an_hdf5_file_is_no_longer_than_the_file(tmp_path: Path) -> None:
    import h5py

    stream = StreamInfo(64, 48, camera="eye")
    path = tmp_path / "a.h5"
    sink = opened(path, "hdf5", stream)
    sink.write(packet(FOUR, stream))
    sink.close()
    with h5py.File(path) as file:
        at = file["evs_stream"].id.get_offset()
    data = bytearray(path.read_bytes())
    data[at : at + 4] = (2_390_000_000).to_bytes(4, "little")
    path.write_bytes(data)
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = files.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 100_000
    # the events are there, what described them is not
    assert read.tobytes() == FOUR.tobytes()
    assert read.stream.camera != "eye"


@pytest.mark.parametrize(
    ("lines", "version", "size", "told"),
    [
        ("% system_ID 21\n", "2.0", (640, 480), "EVT 2.0, 640 x 480 px (Gen3.0), by its system_ID"),
        ("% integrator_name Prophesee\n% system_ID 49\n", "3.0", (1280, 720), "(IMX636), by its"),
        ("% system_ID 40\n", "3.0", (640, 480), "EVT 3.0, 640 x 480 px (Gen3.1), by its system_ID"),
        # what the header states counts
        ("% evt 2.0\n% system_ID 49\n", "2.0", (1280, 720), "1280 x 720 px (IMX636), by its"),
        ("% format EVT2;width=64;height=48\n% system_ID 49\n", "2.0", (64, 48), ""),
    ],
)
def test_old_raw_files_are_read_by_their_system_id(
    tmp_path: Path, lines: str, version: str, size: tuple[int, int], told: str
) -> None:
    path, events = tmp_path / "a.raw", make_events([5, 70, 900], [1, 2, 3], [4, 5, 6], [1, 0, 1])
    encode = {"2.0": encode_evt2, "3.0": encode_evt3}[version]
    words = encode(events, time_origin_us=0, after_us=0)
    path.write_bytes(f"% Date 2019-11-30 10:00:00\n{lines}".encode() + words)
    found = files.read(path)
    assert found.tobytes() == events.tobytes()
    assert (found.stream.width, found.stream.height) == size
    summary = files.summary(path)
    assert summary.format == {"2.0": "evt2", "3.0": "evt3"}[version]
    assert told in summary.read_as
    assert bool(told) == bool(summary.read_as)
