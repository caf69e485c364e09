"""Changed bytes in a recording of any format: an error or a partial read, in bounded memory."""

from __future__ import annotations

import resource
import struct
import tempfile
import warnings
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hdf5_in_process import opened_here
from PIL import Image

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
    TriggerPacket,
    empty_imu,
    frame_triggers,
    make_events,
)
from reference.mutations import changed_by
from reference.old_formats import aedat1, event_stream, nmnist

pytestmark = pytest.mark.property

RECORDED = {
    "aedat4 none": "a.aedat4",
    "aedat4 lz4": "a.aedat4",
    "aedat4 zstd": "a.aedat4",
    "npz": "a.npz",
    "aedat2": "a.aedat",
    "aedat3": "a.aedat3",
    "csv": "a.csv",
    "e2vid": "a.e2vid",
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
"""What our recorders write, by format and compression."""
REBUILT = ("hdf5", "metavision", "rosbag2", "rosbag1", "database")
"""Formats whose repair writes more than it cuts."""
BY_HAND = {
    "davis": "a.aedat",
    "packed": "a.aedat3",
    "dvs128": "a.aedat",
    "dvs": "a.es",
    "atis": "a.es",
    "nmnist": "a.bin",
}
"""What others write."""
NAMES = RECORDED | BY_HAND
QUICK, LONG, VERY_LONG = 20, 300, 6_000
"""Changed files of each kind."""
ROOM = 48 << 20
"""Bytes that a reader may take, over twice the file and what its events themselves need: a piece
of a file and what becomes of it, at the most expanding words."""


def davis() -> bytes:
    """What jAER makes of a DAVIS: events, reads of some pixels twice over, IMU words."""
    head = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
    words = []
    for stamp in range(0, 4000, 40):
        words.append(stamp % 180 << 22 | stamp % 240 << 12 | (stamp & 8) << 8)
        words.append(1 << 31 | stamp % 180 << 22 | stamp % 7 << 12 | (stamp & 64) << 4 | 99)
        if stamp % 400 == 0:
            words += [1 << 31 | 0xC00 | code << 28 | (code * 999) << 12 for code in range(7)]
    return head + b"".join(
        struct.pack(">Ii", word, 25 * number) for number, word in enumerate(words)
    )


def packed() -> bytes:
    """What cAER makes with compression: runs of one stamp, a PNG frame, a plain one, IMU9."""

    def packet(kind: int, size: int, stamp_at: int, count: int, body: bytes) -> bytes:
        capacity = len(body) if kind & 0x8000 else count
        return struct.pack("<HhiiiIii", kind, 1, size, stamp_at, 0, capacity, count, count) + body

    out = b"#!AER-DAT3.1\r\n#Format: Compressed\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n"
    picture = BytesIO()
    pixels = np.arange(24, dtype=np.uint16).reshape(4, 6) * 2000
    Image.fromarray(pixels).save(picture, "PNG")
    for tick in range(4):
        run = [(x << 17 | x << 2 | 3) for x in range(20)]
        words = [run[0], tick | 1 << 31, run[1], 18, *run[2:], run[3], tick, run[4], tick + 1]
        out += packet(0x8001, 8, 4, 22, struct.pack("<26I", *words))
        head = [tick + 1, tick + 9, tick + 2, tick + 3, 6, 4, 0, 0]
        frames = struct.pack("<I8i", 1 << 31 | 3, *head) + struct.pack(
            "<i", len(picture.getvalue())
        )
        frames += picture.getvalue() + struct.pack("<I8i", 3, *head) + pixels.tobytes()
        out += packet(0x8002, 84, 12, 2, frames)
        out += packet(4, 48, 4, 1, struct.pack("<Ii10f", 1, tick, *range(10)))
    return out


def seen(side: int) -> tuple[list[int], list[int], list[int], list[int]]:
    """t, x, y, p of 150 events of a square sensor."""
    t = np.sort(np.random.default_rng(4).integers(0, 300_000, 150)).tolist()
    return t, [us % side for us in t], [us * 7 % side for us in t], [us & 1 for us in t]


def written_by_hand(kind: str) -> bytes:
    if kind == "davis":
        return davis()
    if kind == "packed":
        return packed()
    if kind == "dvs128":
        return aedat1(*seen(128))
    if kind == "nmnist":
        return nmnist(*seen(34))
    exposures = [number % 3 == 0 for number in range(150)] if kind == "atis" else None
    return event_stream(64, 48, *seen(48), exposures=exposures)


def recorded(folder: Path, kind: str) -> bytes:
    path = folder / RECORDED[kind]
    name, _, compression = kind.partition(" ")
    sink = files.recorder_for(
        path, compression or None, kind="rosbag2" if name == "database" else name
    )
    held = {stream: stream in sink.streams for stream in Stream}
    sink.open(
        [
            StreamInfo(
                64,
                48,
                config={"a": 1},
                frames=held[Stream.FRAMES],
                imu=held[Stream.IMU],
                triggers=held[Stream.TRIGGERS],
            )
        ]
    )
    random = np.random.default_rng(3)
    for tick in range(6):
        t = np.sort(random.integers(1000 * tick + 1, 1000 * tick + 1001, 25))
        x = random.integers(0, 48, 25)
        frame = Frame(tick, *[1000 * tick] * 4, np.full((4, 6), tick, np.uint8))
        samples = empty_imu(2)
        samples["t"] = 1000 * tick
        if held[Stream.FRAMES]:
            sink.write_frame(frame)
        if held[Stream.TRIGGERS]:
            sink.write_triggers(TriggerPacket(tick, frame_triggers(frame)))
        if held[Stream.IMU]:
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
    made = {kind: recorded(folder, kind) for kind in RECORDED}
    return made | {kind: written_by_hand(kind) for kind in BY_HAND}


def survives(kind: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        for category in (TornTailWarning, DamagedPacketWarning, BackwardsWarning, LeftOutWarning):
            warnings.simplefilter("ignore", category)
        path = Path(folder, NAMES[kind])
        path.write_bytes(data)
        refused, count = "", 0
        before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            recording = files.read(path)
            told = files.summary(path)
            count = len(recording)
            frames, imu, triggers = recording.frames, recording.imu, recording.triggers
        except EvsError as error:
            refused = str(error)
        grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
        assert grown_kib * 1024 < 2 * len(data) + 4 * 16 * count + ROOM
        assert "\n" not in refused
        if refused:
            return
        assert recording.dtype == EVENT_DTYPE
        assert (count, len(frames)) == (told.events, told.frames)
        assert len(imu) == told.imu_samples
        assert kind in REBUILT or len(triggers) == told.triggers
        assert told.frames <= 1000
        if count:
            assert recording["x"].min() >= 0
            assert recording["y"].min() >= 0
            assert recording["x"].max() < recording.stream.width
            assert recording["y"].max() < recording.stream.height
            assert set(recording["p"].tolist()) <= {0, 1}
        try:
            report = files.repair(path)
        except EvsError as error:
            refused = str(error)
        # a repaired file is sound and holds what was readable before
        assert files.read(path).tobytes() == recording.tobytes()
        if refused:
            assert "\n" not in refused
            assert "repair leaves it" in refused
            assert path.read_bytes() == data
            return
        assert kind in REBUILT or files.summary(path).torn_at is None
        assert kind in REBUILT or path.stat().st_size == len(data) - report.cut_bytes
        assert not files.repair(path).needed


@pytest.mark.parametrize(
    "rounds",
    [
        range(QUICK),
        pytest.param(range(QUICK, LONG), marks=pytest.mark.slow),
        pytest.param(range(LONG, VERY_LONG), marks=pytest.mark.campaign),
    ],
    ids=["few", "many", "very many"],
)
@pytest.mark.parametrize("kind", NAMES)
def test_a_changed_file_is_read_or_refused(
    kind: str, rounds: range, originals: dict[str, bytes]
) -> None:
    for seed in rounds:
        try:
            survives(kind, changed_by(Random(seed), originals[kind]))
        except BaseException as error:
            raise AssertionError(f"seed {seed}") from error


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in RECORDED if "aedat4" in kind])
def test_every_single_changed_byte_is_survived(kind: str, originals: dict[str, bytes]) -> None:
    original = originals[kind]
    header = original.index(b"</dv>")
    places = [
        *range(14, 60),
        *range(header, header + 200),
        *range(len(original) - 40, len(original)),
    ]
    for at in places:
        changed = bytearray(original)
        changed[at] ^= 0xFF
        survives(kind, bytes(changed))


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
    path = tmp_path / NAMES[kind]
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
