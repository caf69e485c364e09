"""AEDAT1, Event Stream and N-MNIST: formats that evs reads and does not write."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers import files
from evs.drivers.files.integrity import DamagedPacketWarning, TornTailWarning
from evs.launch.main import main
from evs.msgs import Events, EvsError, make_events
from reference.old_formats import AEDAT1_HEAD, aedat1, event_stream, nmnist
from reference.oracles import ORACLES_PYTHON, OracleProgram
from reference.streams import random_events

SCRIPT = Path(__file__).parents[2] / "support" / "oracles" / "tonic_oracle.py"
tonic = OracleProgram(SCRIPT, ORACLES_PYTHON)


def columns(events: Events) -> list[list[int]]:
    return [events[name].tolist() for name in "txyp"]


def test_aedat1_is_read(tmp_path: Path) -> None:
    events = random_events(100_000, -1, 1 << 31 - 1, (128, 128))
    path = tmp_path / "a.aedat"
    path.write_bytes(aedat1(*columns(events)))
    read = files.read(path)
    assert read.tobytes() == events.tobytes()
    assert (read.stream.width, read.stream.height, read.stream.sensor) == (128, 128, "dvs128")
    # jAER's first ending was .dat, which is Prophesee's too
    other = path.rename(tmp_path / "a.dat")
    assert files.read(other).tobytes() == events.tobytes()


def test_aedat1_has_the_addresses_of_a_dvs128_in_aedat2(tmp_path: Path) -> None:
    words = np.random.default_rng(1).integers(0, 1 << 16, 3000)
    stamps = range(0, 3_000_000, 1000)
    first, second = tmp_path / "1.aedat", tmp_path / "2.aedat"
    first.write_bytes(
        AEDAT1_HEAD
        + b"".join(struct.pack(">HI", *pair) for pair in zip(words, stamps, strict=True))
    )
    second.write_bytes(
        b"#!AER-DAT2.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n"
        + b"".join(struct.pack(">II", *pair) for pair in zip(words, stamps, strict=True))
    )
    assert files.read(first).tobytes() == files.read(second).tobytes()
    # half of the words are of the external input
    assert 1300 < len(files.read(first)) < 1700
    opened = files.opened(first)
    assert sum(len(part) for part in opened.events()) == 3000 - opened.left_out["sync words"]


def test_aedat1_wraps_its_clock_and_may_be_torn(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    events = make_events([5, (1 << 31) - 1], [1, 2], [3, 4], [1, 0])
    after = struct.pack(">Hi", 0, -(1 << 31))
    path.write_bytes(aedat1(*columns(events)) + after + b"abcde")
    with pytest.warns(TornTailWarning, match="5 bytes"):
        assert files.read(path)["t"].tolist() == [5, (1 << 31) - 1, 1 << 31]
    assert main(["info", str(path), "--repair"]) == 0
    assert len(files.read(path)) == 3


def test_aedat1_without_a_header_is_refused_with_the_fix(tmp_path: Path) -> None:
    events = random_events(1000, -1, 1 << 20 - 1, (128, 128))
    path = tmp_path / "a.aedat"
    path.write_bytes(aedat1(*columns(events), head=b""))
    with pytest.raises(EvsError, match=r"put the line #!AER-DAT1\.0 before it"):
        files.read(path)
    path.write_bytes(b"#!AER-DAT1.0\n" + path.read_bytes())
    assert files.read(path).tobytes() == events.tobytes()


@pytest.mark.integration
@pytest.mark.parametrize(
    ("count", "span_us", "side"),
    [(4000, 300_000, 34), (100_000, 300_000, 180), (20_000, 20_000_000, 240)],
)
def test_nmnist_is_read_as_tonic_reads_it(
    tmp_path: Path, count: int, span_us: int, side: int
) -> None:
    events = random_events(count, -1, span_us - 1, (side, side))
    path = tmp_path / "a.bin"
    path.write_bytes(nmnist(*columns(events)))
    read = files.read(path)
    assert read.tobytes() == events.tobytes()
    size = (34, 34) if side == 34 else (304, 240)
    assert (read.stream.width, read.stream.height) == size
    (seen,) = tonic(path)
    assert (seen["events"], seen["digest"]) == (count, tonic.digest(events))


def test_a_torn_or_damaged_nmnist_file(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    events = random_events(100, -1, 1000 - 1, (34, 34))
    path.write_bytes(nmnist(*columns(events)) + bytes([3, 250, 0, 4, 0, 1, 1]))
    with (
        pytest.warns(TornTailWarning, match="2 bytes"),
        pytest.warns(DamagedPacketWarning, match="1 damaged events.*at byte 500"),
    ):
        assert files.read(path).tobytes() == events.tobytes()
    path.write_bytes(b"abc")
    with pytest.raises(EvsError, match="3 bytes, an event has 5"):
        files.read(path)


FAERY = """
import sys, numpy as np, faery
given = np.load(sys.argv[1])
every = np.zeros(len(given), faery.EVENTS_DTYPE)
for column, name in enumerate(("t", "x", "y", "on")):
    every[name] = given[:, column]
faery.events_stream_from_array(every, dimensions=(1280, 720)).to_file(sys.argv[2])
"""


@pytest.mark.slow
@pytest.mark.parametrize("span_us", [100_000, 3_000_000, 300_000_000])
def test_faerys_event_stream_is_read(tmp_path: Path, span_us: int) -> None:
    events = random_events(120_000, -1, span_us - 1, (1280, 720))
    # faery counts from the first event
    events["t"] -= events["t"][0]
    given_path, path = tmp_path / "a.npy", tmp_path / "a.es"
    np.save(given_path, np.stack(columns(events), axis=1))
    command = [sys.executable, "-c", FAERY, str(given_path), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    read = files.read(path)
    assert read.tobytes() == events.tobytes()
    assert (read.stream.width, read.stream.height) == (1280, 720)
    # and by hand
    path.write_bytes(event_stream(1280, 720, *columns(events)))
    assert files.read(path).tobytes() == events.tobytes()


def test_the_changes_of_an_atis_are_read_and_its_exposures_counted(tmp_path: Path) -> None:
    events = random_events(50_000, -1, 10_000_000 - 1, (304, 240))
    exposures = np.random.default_rng(2).integers(0, 2, len(events)) == 1
    path = tmp_path / "a.es"
    path.write_bytes(event_stream(304, 240, *columns(events), exposures=exposures.tolist()))
    with pytest.warns(files.LeftOutWarning, match=f"{np.count_nonzero(exposures)} exposure events"):
        list(files.messages(path))
    assert np.array_equal(files.read(path), events[~exposures])


def plainly(data: bytes, kind: int) -> list[tuple[int, int, int, int]]:
    """The events of an Event Stream of 64 x 48 px, byte by byte; those outside are left out."""
    found, at, t = [], 0, 0
    while at < len(data):
        first = data[at]
        if first >= (0xFE if kind == 1 else 0xFC):
            t += 127 * (first & 1) if kind == 1 else 63 * (first & 3)
            at += 1
        elif at + 5 > len(data):
            break
        else:
            x, y = struct.unpack("<HH", data[at + 1 : at + 5])
            t += first >> kind
            if x < 64 and y < 48 and not (kind == 2 and first & 1):
                found.append((t, x, 47 - y, first >> kind - 1 & 1))
            at += 5
    return found


@pytest.mark.filterwarnings("ignore::UserWarning")
@settings(max_examples=200, deadline=None)
@given(
    kind=st.integers(1, 2),
    body=st.lists(
        st.one_of(
            st.sampled_from([b"\xff", b"\xfe", b"\xfc", b"\xfd", b"\x04\x01\0\x02\0"]),
            st.binary(min_size=1, max_size=7),
        )
    ).map(b"".join),
)
def test_any_bytes_are_read_as_a_plain_loop_reads_them(
    tmp_path_factory: pytest.TempPathFactory, kind: int, body: bytes
) -> None:
    path = tmp_path_factory.mktemp("es") / "a.es"
    path.write_bytes(event_stream(64, 48, [], [], [], [])[:15] + struct.pack("<BHH", kind, 64, 48))
    with path.open("ab") as file:
        file.write(body)
    # `read` refuses a file of nothing but events outside of the sensor
    parts = files.opened(path).events()
    assert [event for part in parts for event in part.tolist()] == plainly(body, kind)


def test_other_event_streams_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.es"
    sound = event_stream(64, 48, [], [], [], [])
    for at, byte, message in (
        (0, 0, "must begin with 'Event Stream'"),
        (12, 1, "version 1; version 2 is read"),
        (15, 4, "no DVS or ATIS events but colour ones"),
        (15, 9, "but type 9 ones"),
        (16, 0, "a sensor of 0 x 48 px"),
        (19, 255, "a sensor of 64 x 65328 px"),
    ):
        path.write_bytes(sound[:at] + bytes([byte]) + sound[at + 1 :])
        with pytest.raises(EvsError, match=message):
            files.read(path)
    path.write_bytes(sound)
    assert len(files.read(path)) == 0


def test_they_become_every_format_but_are_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = random_events(500, -1, 100_000 - 1, (64, 48))
    path = tmp_path / "a.es"
    path.write_bytes(event_stream(64, 48, *columns(events)))
    assert main(["convert", str(path), str(tmp_path / "a.aedat4")]) == 0
    assert files.read(tmp_path / "a.aedat4").tobytes() == events.tobytes()
    capsys.readouterr()
    assert main(["convert", str(tmp_path / "a.aedat4"), str(tmp_path / "b.es")]) == 2
    assert "Event Stream is read but not written" in capsys.readouterr().err
    assert not (tmp_path / "b.es").exists()
    with pytest.raises(EvsError, match="N-MNIST is read but not written"):
        files.recorder_for(tmp_path / "b.bin")
    with pytest.raises(EvsError, match="Event Stream is read but not written"):
        files.recorder_for(tmp_path / "b.aedat4", kind="es")
