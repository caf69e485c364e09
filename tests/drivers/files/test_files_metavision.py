"""Metavision's HDF5: the layout that OpenEB's readers need, and the files that others write."""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
import pytest

from evs.drivers import files
from evs.drivers.files.integrity import DamagedPacketWarning
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, join_events, make_events
from evs.msgs.codecs.ecf import decode_ecf, encode_ecf

ECF = 0x8ECF
CHUNK = 16_384
STREAM = StreamInfo(1280, 720, camera="eye", sensor="imx636", seed=7, config={"a": [1]})
CD = np.dtype(
    {
        "names": ["x", "y", "p", "t"],
        "formats": ["<u2", "<u2", "<i2", "<i8"],
        "offsets": [0, 2, 4, 8],
        "itemsize": 16,
    }
)


def random_events(count: int, first_us: int = 5_300) -> Events:
    """Dense and sparse parts, and a pause of many entries of the index."""
    random = np.random.default_rng(count)
    t = np.cumsum(random.integers(0, 3, count) * random.choice([1, 1, 1, 900], count))
    t[count // 2 :] += 50_000
    x, y = random.integers(0, 1280, count), random.integers(0, 720, count)
    return make_events(first_us + t - t[0], x, y, random.integers(0, 2, count))


def recorded(path: Path, events: Events, packets: int = 7) -> None:
    sink = files.recorder_for(path)
    sink.open([STREAM])
    for seq, part in enumerate(np.array_split(events, packets)):
        sink.write(EventPacket(seq, 0, 0, 1280, 720, part, "eye"))
    sink.close()


def rows_of(events: Events) -> npt.NDArray[Any]:
    rows = np.zeros(len(events), CD)
    for name in "xypt":
        rows[name] = events[name]
    return rows


@pytest.mark.parametrize("count", [1, 2, CHUNK, CHUNK + 1, 3 * CHUNK - 5])
def test_the_layout_is_openebs(tmp_path: Path, count: int) -> None:
    path, events = tmp_path / "run.hdf5", random_events(count)
    recorded(path, events)
    assert files.read(path).tobytes() == events.tobytes()
    assert files.stream_of(path) == STREAM
    found = files.summary(path)
    assert (found.format, found.compression, found.damaged_packets) == ("metavision", "ecf", 0)
    with h5py.File(path) as file:
        # texts in ASCII: OpenEB's reader converts no others
        for attributes, name, text in (
            (file.attrs, "version", "1.0"),
            (file.attrs, "geometry", "1280x720"),
            (file["CD/indexes"].attrs, "offset", str(-int(events["t"][0]))),
        ):
            kind = attributes.get_id(name).get_type()
            assert (kind.is_variable_str(), kind.get_cset()) == (True, h5py.h5t.CSET_ASCII)
            assert attributes[name] == text
        stored = file["CD/events"]
        assert (stored.dtype, stored.chunks, len(stored)) == (CD, (CHUNK,), count)
        layout = stored.id.get_create_plist()
        assert [layout.get_filter(k)[0] for k in range(layout.get_nfilters())] == [ECF]
        # whatever reads chunks by itself gets whole ones, and the rest of the last
        parts = [
            decode_ecf(stored.id.read_direct_chunk((begin,))[1]) for begin in range(0, count, CHUNK)
        ]
        assert [len(part) for part in parts] == [
            min(CHUNK, count - begin) for begin in range(0, count, CHUNK)
        ]
        assert join_events(parts).tobytes() == events.tobytes()
        # OpenEB reads those as they lie in the file
        for name in ("CD/indexes", "EXT_TRIGGER/events", "EXT_TRIGGER/indexes"):
            assert file[name].chunks == (CHUNK,)
            assert file[name].id.get_create_plist().get_nfilters() == 0
        assert len(file["EXT_TRIGGER/events"]) == len(file["EXT_TRIGGER/indexes"]) == 0
        assert file["EXT_TRIGGER/events"].dtype.itemsize == 24
        check_index(events, file["CD/indexes"][()])


def check_index(events: Events, index: npt.NDArray[Any]) -> None:
    """Entry k + 1 is of the first event of the last slot of 2 ms, up to slot k, with any."""
    slots = (events["t"] - events["t"][0]) // 2000
    wanted = [(0, -1)]
    for slot in range(int(slots[-1]) + 1):
        last = slots[slots <= slot][-1]
        first = int(np.flatnonzero(slots == last)[0])
        wanted.append((first, int(events["t"][first] - events["t"][0])))
    assert index.tolist() == wanted


def test_a_recording_without_events_is_empty(tmp_path: Path) -> None:
    path = tmp_path / "run.hdf5"
    sink = files.recorder_for(path)
    sink.open([STREAM])
    sink.close()
    assert len(files.read(path)) == 0
    assert files.stream_of(path) == STREAM


def foreign(path: Path, events: Events, **kinds: Any) -> Any:
    """A file with CD/events as h5py writes it, and the text of the size as OpenEB does."""
    file = h5py.File(path, "w")
    file.attrs.create("geometry", "1280x720", dtype=h5py.string_dtype("ascii"))
    kinds |= {"chunks": (CHUNK,), "maxshape": (None,)}
    return file, file.create_dataset("CD/events", (len(events),), CD, **kinds)


PLAIN: list[dict[str, Any]] = [{}, {"compression": 4, "shuffle": True}, {"compression": "lzf"}]


@pytest.mark.parametrize("ending", [".h5", ".hdf5"])
@pytest.mark.parametrize("kinds", PLAIN, ids=str)
def test_files_without_ecf_are_read(tmp_path: Path, kinds: dict[str, Any], ending: str) -> None:
    path, events = tmp_path / f"other{ending}", random_events(40_000)
    file, stored = foreign(path, events, **kinds)
    stored[:] = rows_of(events)
    file.close()
    recording = files.read(path)
    assert recording.tobytes() == events.tobytes()
    assert (recording.stream.width, recording.stream.height) == (1280, 720)
    assert files.summary(path).format == "metavision"


def test_external_triggers_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "other.hdf5"
    with h5py.File(path, "w") as file:
        file["CD/events"] = rows_of(random_events(50))
        file["EXT_TRIGGER/events"] = np.zeros(3, [("p", "<i2"), ("t", "<i8"), ("id", "<i2")])
    found = files.summary(path)
    assert (found.events, found.left_out) == (50, {"external triggers": 3})


UNKNOWN = {"compression": ECF, "allow_unknown_filter": True}


def test_chunks_whose_writer_lacked_the_filter_are_read(tmp_path: Path) -> None:
    path, events = tmp_path / "other.hdf5", random_events(CHUNK + 90)
    file, stored = foreign(path, events, **UNKNOWN)
    stored.id.write_direct_chunk((0,), encode_ecf(events[:CHUNK]))
    rest = np.zeros(CHUNK, CD)
    rest[:90] = rows_of(events[CHUNK:])
    stored.id.write_direct_chunk((CHUNK,), rest.tobytes(), filter_mask=1)
    file.close()
    assert files.read(path).tobytes() == events.tobytes()


def test_damaged_chunks_are_left_out_and_the_rest_is_read(tmp_path: Path) -> None:
    path, events = tmp_path / "other.hdf5", random_events(4 * CHUNK)
    file, stored = foreign(path, events, **UNKNOWN)
    # the second is torn, the third is not there
    for number, part in enumerate(np.array_split(events, 4)):
        data = encode_ecf(part)
        if number != 2:
            stored.id.write_direct_chunk((CHUNK * number,), data[:99] if number == 1 else data)
    file.close()
    with pytest.warns(DamagedPacketWarning, match=f"{2 * CHUNK} damaged events .* {CHUNK} on: ECF"):
        recording = files.read(path)
    sound = join_events([events[:CHUNK], events[3 * CHUNK :]])
    assert recording.tobytes() == sound.tobytes()


@pytest.mark.integration
def test_what_cannot_be_a_recording_is_refused_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "a.hdf5"

    def with_sets(kind: Any, count: int, **kinds: Any) -> None:
        with h5py.File(path, "w") as file:
            kinds |= {"chunks": (CHUNK,), "maxshape": (None,)}
            file.create_dataset("CD/events", (count,), kind, **kinds)

    for make, said in (
        (lambda: with_sets([("x", "u2"), ("t", "i8")], 3), "has no x, y, p, t"),
        (lambda: with_sets([(name, "f4") for name in "xypt"], 3), "has no numbers for x, y"),
        (lambda: with_sets(CD, 1 << 40), "states 17592186044416 bytes, which cannot be in it"),
        (lambda: with_sets(CD, 60, **UNKNOWN), "states 60 events, which cannot be in it"),
        (lambda: with_sets(CD, 3, shuffle=True, **UNKNOWN), "filters in addition to ECF"),
        (lambda: with_sets("u2", 3), "has no x, y, p, t"),
    ):
        make()
        with pytest.raises(EvsError, match=said):
            files.read(path)
    with pytest.raises(EvsError, match="cannot record an event at -3 us"):
        recorded(path, make_events([-3], [1], [1], [1]), 1)


def test_a_size_of_any_stated_length_costs_no_memory(tmp_path: Path) -> None:
    path, events = tmp_path / "other.hdf5", random_events(500)
    file, stored = foreign(path, events, **UNKNOWN)
    stored.id.write_direct_chunk((0,), encode_ecf(events))
    file.close()
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL").to_bytes(8, "little")
    at = data.index((8).to_bytes(4, "little") + heap)
    data[at : at + 4] = (2_000_000_000).to_bytes(4, "little")
    path.write_bytes(data)
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    recording = files.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 100_000
    assert recording.tobytes() == events.tobytes()
    assert (recording.stream.width, recording.stream.height) == (1280, 720)


def test_without_a_size_the_events_give_it(tmp_path: Path) -> None:
    path = tmp_path / "other.hdf5"
    events = make_events([1, 2], [30, 4], [5, 60], [1, 0])
    with h5py.File(path, "w") as file:
        file["CD/events"] = rows_of(events)
    recording = files.read(path)
    assert recording.tobytes() == events.tobytes()
    assert (recording.stream.width, recording.stream.height) == (31, 61)
