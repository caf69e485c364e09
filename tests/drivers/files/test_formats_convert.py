"""evs convert between RAW, DAT, HDF5, bags and every other format."""

from __future__ import annotations

from pathlib import Path

import pytest

from evs.drivers import files
from evs.drivers.files import RECORDED, convert
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, make_events
from evs.msgs.codecs import PAYLOADS
from reference.recordings import STREAM, events, record

FOREIGN = ("evt3", "evt2", "evt21", "dat", "hdf5", "metavision", "rosbag2", "rosbag1")
OWN = {"aedat4", "npz", "aedat2", "aedat3", "csv", "txt", "e2vid"}
ENDINGS = {one.name: one.suffixes[0] for one in RECORDED}


@pytest.mark.parametrize("source", ENDINGS)
def test_every_format_becomes_the_next(tmp_path: Path, source: str) -> None:
    order = list(ENDINGS)
    target = order[(order.index(source) + 1) % len(order)]
    converts(tmp_path, source, target)


@pytest.mark.slow
@pytest.mark.parametrize("source", ENDINGS)
@pytest.mark.parametrize("target", ENDINGS)
def test_every_format_becomes_every_other(tmp_path: Path, source: str, target: str) -> None:
    converts(tmp_path, source, target)


def converts(tmp_path: Path, source: str, target: str) -> None:
    given = record(tmp_path / f"in{ENDINGS[source]}", source)
    shares: list[float] = []
    made = tmp_path / f"out{ENDINGS[target]}"
    done = convert(given, made, kind=target, progress=shares.append)
    assert (done.events, done.files, done.left_out) == (3000, [made], {})
    assert files.read(made).tobytes() == events().tobytes()
    assert files.summary(made).format == target
    assert files.summary(made).packets == 40
    # DAT keeps nothing but the size
    told = files.stream_of(made)
    assert (told.width, told.height) == (346, 260)
    assert told == STREAM
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1
    if {source, target} <= OWN:
        # and the way back gives the first file's bytes
        again = tmp_path / f"again{ENDINGS[source]}"
        convert(made, again)
        assert again.read_bytes() == given.read_bytes()


@pytest.mark.parametrize("encoding", [*PAYLOADS, "dvs"])
def test_the_encoding_of_a_bag_can_be_chosen(
    tmp_path: Path, encoding: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = record(tmp_path / "in.raw", "evt3")
    for name in ("out.mcap", "out.bag"):
        made = tmp_path / name
        assert main(["convert", str(given), str(made), "--encoding", encoding, "--quiet"]) == 0
        assert files.read(made).tobytes() == events().tobytes()
        kind = b"dvs_msgs/" if encoding == "dvs" else b"event_camera_msgs/"
        assert kind in made.read_bytes()
    assert main(["convert", str(given), str(tmp_path / "out.h5"), "--encoding", encoding]) == 2
    assert "has no option encoding" in capsys.readouterr().err
    assert not (tmp_path / "out.h5").exists()


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_a_format_cannot_hold_is_refused_before_writing(tmp_path: Path, kind: str) -> None:
    given = tmp_path / "in.aedat4"
    sink = files.recorder_for(given)
    sink.open([STREAM])
    early = make_events([-7, 5], [1, 2], [3, 4], [0, 1])
    sink.write(EventPacket(0, -1000, 1000, 346, 260, early, "eye"))
    sink.close()
    target = tmp_path / f"out{ENDINGS[kind]}"
    if kind == "hdf5":
        convert(given, target)
        assert files.read(target).tobytes() == early.tobytes()
        return
    target.write_bytes(b"what was there")
    with pytest.raises(EvsError, match=r"cannot record an event at -7 us .*; .* holds 0 \.\.\."):
        convert(given, target, kind=kind)
    assert target.read_bytes() == b"what was there"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["in.aedat4", target.name]
