"""Changed bytes in RAW, DAT, HDF5 and bag files: an error or a partial read, in bounded memory."""

from __future__ import annotations

import resource
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hdf5_in_process import opened_here
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from evs.drivers import files
from evs.drivers.files import LeftOutWarning
from evs.drivers.files.hdf5 import reader
from evs.drivers.files.integrity import BackwardsWarning, DamagedPacketWarning, TornTailWarning
from evs.drivers.sink import Stream
from evs.msgs import (
    EVENT_DTYPE,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    StreamInfo,
    empty_imu,
    make_events,
)
from reference.mutations import changed_by, mutations

pytestmark = pytest.mark.property

KINDS = {
    "evt3": "a.raw",
    "evt2": "a.raw",
    "evt21": "a.raw",
    "dat": "a.dat",
    "hdf5": "a.h5",
    "metavision": "a.hdf5",
    "rosbag2": "a.mcap",
    "rosbag1": "a.bag",
    "database": "a.db3",
}
QUICK = 60
LONG = 4000
ROOM = 48 << 20
"""Bytes that a reader may take, over twice the file and what its events themselves need: a piece
of a file and what becomes of it, at the most expanding words."""


def recorded(folder: Path, kind: str) -> bytes:
    path = folder / KINDS[kind]
    sink = files.recorder_for(path, kind="rosbag2" if kind == "database" else kind)
    auxiliary = Stream.FRAMES in sink.streams
    sink.open([StreamInfo(64, 48, config={"a": 1}, frames=auxiliary, imu=auxiliary)])
    random = np.random.default_rng(3)
    for tick in range(6):
        t = np.sort(random.integers(1000 * tick + 1, 1000 * tick + 1001, 25))
        x = random.integers(0, 48, 25)
        if Stream.FRAMES in sink.streams and Stream.IMU in sink.streams:
            stamp = 1000 * tick
            sink.write_frame(Frame(tick, *[stamp] * 4, np.full((4, 6), tick, np.uint8)))
            samples = empty_imu(2)
            samples["t"] = stamp
            sink.write_imu(ImuPacket(tick, samples))
        sink.write(EventPacket(tick, 0, 0, 64, 48, make_events(t, x, x, x % 2)))
    sink.close()
    return path.read_bytes()


@pytest.fixture(scope="module", autouse=True)
def _hdf5_in_process() -> Iterator[None]:
    """A process that reads HDF5 is replaced after each error."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "opened", opened_here)
        yield


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of a small recording of each kind."""
    folder = tmp_path_factory.mktemp("originals")
    return {kind: recorded(folder, kind) for kind in KINDS}


def survives(kind: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        for category in (TornTailWarning, DamagedPacketWarning, BackwardsWarning, LeftOutWarning):
            warnings.simplefilter("ignore", category)
        path = Path(folder, KINDS[kind])
        path.write_bytes(data)
        refused, count = "", 0
        before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            recording = files.read(path)
            told = files.summary(path)
            count = len(recording)
        except EvsError as error:
            refused = str(error)
        grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
        assert grown_kib * 1024 < 2 * len(data) + 4 * 16 * count + ROOM
        assert "\n" not in refused
        if refused:
            return
        assert recording.dtype == EVENT_DTYPE
        assert told.frames <= 1000
        assert len(recording.frames) == told.frames
        assert len(recording.imu) == told.imu_samples
        assert count == told.events
        if count:
            assert recording["x"].min() >= 0
            assert recording["y"].min() >= 0
            assert recording["x"].max() < recording.stream.width
            assert recording["y"].max() < recording.stream.height
            assert set(recording["p"].tolist()) <= {0, 1}
        # a repaired file holds what was readable before
        try:
            files.repair(path)
        except EvsError as error:
            refused = str(error)
        assert "\n" not in refused
        assert files.read(path).tobytes() == recording.tobytes()
        if not refused:
            assert not files.repair(path).needed


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=QUICK, deadline=5000, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_changed_file_is_read_or_refused(
    kind: str, data: st.DataObject, originals: dict[str, bytes]
) -> None:
    survives(kind, data.draw(mutations(originals[kind])))


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=LONG, deadline=5000, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_very_many_changed_files_are_read_or_refused(
    kind: str, data: st.DataObject, originals: dict[str, bytes]
) -> None:
    survives(kind, data.draw(mutations(originals[kind])))


@pytest.mark.parametrize(
    ("kind", "seed"),
    # a chunk that is damaged within, a record without a header, two records of one connection; a
    # file that ends before its first word
    [("rosbag1", 4), ("rosbag1", 666), ("rosbag1", 9257), ("evt21", 3045)],
)
def test_what_was_once_repaired_wrongly(kind: str, seed: int, originals: dict[str, bytes]) -> None:
    survives(kind, changed_by(Random(seed), originals[kind]))


@pytest.mark.parametrize("kind", ["evt3", "evt2", "evt21", "dat"])
def test_a_file_cut_anywhere_is_read_up_to_there(
    kind: str, originals: dict[str, bytes], tmp_path: Path
) -> None:
    path = tmp_path / KINDS[kind]
    path.write_bytes(originals[kind])
    whole = files.read(path)
    data = originals[kind]
    begin = data.index(b"% end\n") + 6 if kind != "dat" else data.index(b"\x0c\x08") + 2
    word = {"evt3": 2, "evt2": 4, "evt21": 8, "dat": 8}[kind]
    for cut in range(begin, len(data), 7):
        path.write_bytes(data[:cut])
        torn = (cut - begin) % word
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            part = files.read(path)
        assert part.tobytes() == whole[: len(part)].tobytes()
        assert len(part) >= (cut - begin) * len(whole) // (len(data) - begin) - 6
        assert [str(each.category.__name__) for each in caught] == ["TornTailWarning"] * bool(torn)
        assert files.summary(path).torn_at == (cut - torn if torn else None)
        report = files.repair(path)
        assert report.cut_bytes == torn
        assert files.read(path).tobytes() == part.tobytes()
