"""Changed bytes in a recording never crash, hang or flood a reader."""

from __future__ import annotations

import resource
import struct
import tempfile
import warnings
from io import BytesIO
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from evs.drivers import files
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
from reference.mutations import changed_by, mutations
from reference.old_formats import aedat1, event_stream, nmnist

pytestmark = pytest.mark.property

KINDS = [
    ("a.aedat4", "none"),
    ("a.aedat4", "lz4"),
    ("a.aedat4", "zstd"),
    ("a.npz", "lz4"),
    ("a.aedat", "none"),
    ("a.aedat3", "none"),
    ("a.csv", "none"),
    ("a.e2vid", "none"),
    ("davis.aedat", "none"),
    ("packed.aedat3", "none"),
    ("dvs128.aedat", "none"),
    ("dvs.es", "none"),
    ("atis.es", "none"),
    ("nmnist.bin", "none"),
]
QUICK = 120
LONG, VERY_LONG = 300, 6_000
"""Of each kind."""


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


def recorded(folder: Path, name: str, compression: str) -> bytes:
    by_hand = {
        "davis.aedat": davis,
        "packed.aedat3": packed,
        "dvs128.aedat": lambda: aedat1(*seen(128)),
        "dvs.es": lambda: event_stream(64, 48, *seen(48)),
        "atis.es": lambda: event_stream(
            64, 48, *seen(48), exposures=[number % 3 == 0 for number in range(150)]
        ),
        "nmnist.bin": lambda: nmnist(*seen(34)),
    }
    if name in by_hand:
        return by_hand[name]()
    path = folder / name
    sink = files.recorder_for(path, compression)
    sink.open([StreamInfo(64, 48, config={"a": 1}, frames=True, imu=True, triggers=True)])
    random = np.random.default_rng(3)
    for tick in range(6):
        t = np.sort(random.integers(1000 * tick + 1, 1000 * tick + 1001, 25))
        x = random.integers(0, 48, 25)
        if tick == 3:
            image = random.integers(0, 9, (4, 5)).astype(np.uint8)
            frame = Frame(0, 1, 2, 3, 4, image)
            samples = empty_imu(2)
            samples["t"] = 2500, 3000
            # those that hold them
            if Stream.FRAMES in sink.streams:
                sink.write_frame(frame)
            if Stream.TRIGGERS in sink.streams:
                sink.write_triggers(TriggerPacket(0, frame_triggers(frame)))
            if Stream.IMU in sink.streams:
                sink.write_imu(ImuPacket(0, samples))
        sink.write(EventPacket(tick, 0, 0, 64, 48, make_events(t, x, x, x % 2)))
    sink.close()
    return path.read_bytes()


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], bytes]:
    """The bytes of a small recording of each kind."""
    folder = tmp_path_factory.mktemp("originals")
    return {kind: recorded(folder, *kind) for kind in KINDS}


def survives(name: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", TornTailWarning)
        warnings.simplefilter("ignore", DamagedPacketWarning)
        warnings.simplefilter("ignore", BackwardsWarning)
        warnings.simplefilter("ignore", files.LeftOutWarning)
        path = Path(folder, name)
        path.write_bytes(data)
        peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        refused = ""
        try:
            recording = files.read(path)
            told = files.summary(path)
            auxiliary = len(recording.frames), len(recording.imu), len(recording.triggers)
        except EvsError as error:
            refused = str(error)
        grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kib
        assert grown_kib < 100_000
        assert "\n" not in refused
        if refused:
            return
        assert recording.dtype == EVENT_DTYPE
        assert len(recording) == told.events
        assert auxiliary == (told.frames, told.imu_samples, told.triggers)
        if len(recording):
            assert recording["x"].min() >= 0
            assert recording["y"].min() >= 0
            assert recording["x"].max() < recording.stream.width
            assert recording["y"].max() < recording.stream.height
            assert set(recording["p"].tolist()) <= {0, 1}
        try:
            report = files.repair(path)
        except EvsError as error:
            refused = str(error)
        if refused:
            assert "repair leaves it" in refused
            assert path.read_bytes() == data
            return
        # a repaired file is sound and holds what was readable before
        assert files.summary(path).torn_at is None
        assert files.read(path).tobytes() == recording.tobytes()
        assert path.stat().st_size == len(data) - report.cut_bytes
        assert not files.repair(path).needed


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=QUICK, deadline=5000, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_changed_file_is_read_or_refused(
    kind: tuple[str, str], data: st.DataObject, originals: dict[tuple[str, str], bytes]
) -> None:
    survives(kind[0], data.draw(mutations(originals[kind])))


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [LONG, pytest.param(VERY_LONG, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("kind", KINDS)
def test_very_many_changed_files_are_read_or_refused(
    kind: tuple[str, str], rounds: int, originals: dict[tuple[str, str], bytes]
) -> None:
    for seed in range(rounds):
        data = changed_by(Random(seed), originals[kind])
        try:
            survives(kind[0], data)
        except BaseException as error:
            raise AssertionError(f"seed {seed}") from error


@pytest.mark.parametrize("kind", KINDS[:3])
def test_every_single_changed_byte_is_survived(
    kind: tuple[str, str], originals: dict[tuple[str, str], bytes]
) -> None:
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
        survives(kind[0], bytes(changed))
