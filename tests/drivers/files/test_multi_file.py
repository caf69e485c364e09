"""A recording in several files is one; nothing else is taken for a part of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evs
from evs.drivers import files
from evs.drivers.files.integrity import TornTailWarning
from evs.launch.main import main
from evs.msgs import (
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuPacket,
    StreamInfo,
    empty_imu,
    join_events,
    make_events,
)
from reference.streams import random_packet

STREAM = StreamInfo(346, 260, camera="eye", seed=4, frames=True, imu=True)


def record(path: Path, ticks: int = 40, seed: int = 4, **options: Any) -> Events:
    sink: Any = files.recorder_for(path, **{"rotate_s": 0.01, **options})
    sink.open([StreamInfo(346, 260, camera="eye", seed=seed, frames=True, imu=True)])
    for tick in range(ticks):
        at = 1000 * tick
        if tick % 7 == 1:
            sink.write_frame(Frame(tick // 7, at, at, at, at, np.full((4, 6), tick, np.uint8)))
        samples = empty_imu(1)
        samples["t"] = at
        sink.write_imu(ImuPacket(tick, samples))
        sink.write(random_packet(tick, 30))
    sink.close()
    return join_events([random_packet(tick, 30).events for tick in range(ticks)])


def test_the_first_file_is_all_of_it(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    whole = record(path)
    names = ["run.aedat4", *(f"run-00{n}.aedat4" for n in (1, 2, 3))]
    assert sorted(one.name for one in tmp_path.iterdir()) == sorted(names)
    got = evs.read(path)
    assert got.tobytes() == whole.tobytes()
    assert [frame.seq for frame in got.frames] == list(range(6))
    assert len(got.imu) == 40
    assert got.stream == STREAM
    assert [one.name for one in files.parts(path)] == names
    assert sum(len(one) for one in files.packets(path)) == len(whole)
    found = files.summary(path)
    assert (found.events, found.frames, found.imu_samples, found.packets) == (1200, 6, 40, 40)
    assert found.size == sum(one.stat().st_size for one in tmp_path.iterdir())
    assert found.table
    # one alone, if it is asked for
    assert len(evs.read(path, single=True)) == files.summary(path, single=True).events == 300
    assert len(evs.read(path, single=True).imu) == 10
    assert len(evs.read(tmp_path / names[1])) == 300
    assert files.parts(tmp_path / names[1]) == [tmp_path / names[1]]


def test_the_commands_take_all_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.aedat4"
    whole = record(path)
    assert main(["convert", str(path), str(tmp_path / "a.npz"), "--quiet"]) == 0
    assert evs.read(tmp_path / "a.npz").tobytes() == whole.tobytes()
    assert main(["convert", str(path), str(tmp_path / "b.npz"), "--quiet", "--single"]) == 0
    assert len(evs.read(tmp_path / "b.npz")) == 300
    with pytest.raises(EvsError, match="is the recording to be converted"):
        files.convert(path, tmp_path / "run-002.aedat4")
    capsys.readouterr()
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"files       4, up to {tmp_path / 'run-003.aedat4'}" in said
    assert "1,200 (" in said
    assert "goes on in" not in said
    assert main(["info", str(path), "--single"]) == 0
    said = capsys.readouterr().out
    assert f"goes on in  {tmp_path / 'run-001.aedat4'} and 2 more" in said
    assert "300 (" in said
    assert main(["info", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][-1] == str(tmp_path / "run-003.aedat4")


def test_only_what_continues_it_belongs_to_it(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat4"
    record(path)
    second = tmp_path / "run-002.aedat4"
    kept = second.read_bytes()

    def counted() -> int:
        return len(evs.read(path))

    # a gap
    second.unlink()
    assert counted() == 600
    # of another run
    record(tmp_path / "other.aedat4", seed=5)
    shutil.copy(tmp_path / "other-002.aedat4", second)
    assert counted() == 600
    # of the same run, but not the next part
    shutil.copy(tmp_path / "run-003.aedat4", second)
    assert counted() == 600
    # not rotated at all
    plain = files.recorder_for(second)
    plain.open([STREAM])
    plain.close()
    assert counted() == 600
    second.write_bytes(b"nothing")
    assert counted() == 600
    # earlier than the part before it: recorded again from its begin
    shutil.copy(tmp_path / "run-001.aedat4", tmp_path / "run-001.kept")
    second.write_bytes(kept)
    assert counted() == 1200
    record(tmp_path / "late.aedat4", ticks=5)
    assert len(evs.read(tmp_path / "late.aedat4")) == 150


def test_a_torn_last_part_is_told_by_its_name_and_repaired(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.aedat4"
    whole = record(path, compression="none")
    last = tmp_path / "run-003.aedat4"
    last.write_bytes(last.read_bytes()[:-5])
    with pytest.warns(TornTailWarning, match=f"^{last}: .*--repair {last}"):
        got = evs.read(path)
    assert got.tobytes() == whole[: len(got)].tobytes()
    assert len(got) == 1170
    assert files.summary(path).torn_bytes > 0
    assert main(["info", str(path), "--repair"]) == 0
    assert f"{last}: cut " in capsys.readouterr().out
    assert evs.read(path).tobytes() == got.tobytes()
    # a kill in the header of the next one
    (tmp_path / "run-004.aedat4").write_bytes(b"#!AER")
    assert evs.read(path).tobytes() == got.tobytes()


def test_aedat2s_files_are_one(tmp_path: Path) -> None:
    path = tmp_path / "run.aedat"
    sink = files.recorder_for(path)
    sink.open([StreamInfo(346, 260, camera="eye")])
    span = 1 << 31
    events = make_events(
        [5, span - 1, span, 2 * span + 7], [1, 2, 3, 4], [1, 2, 3, 4], [1, 0, 1, 0]
    )
    sink.write(EventPacket(0, 0, 0, 346, 260, events))
    assert sink.close()["files"] == 3
    assert evs.read(path).tobytes() == events.tobytes()
    assert evs.read(path, single=True).tobytes() == events[:2].tobytes()
    assert evs.read(tmp_path / "run-001.aedat").tobytes() == events[2:3].tobytes()
    assert files.summary(path).files == [str(one) for one in files.parts(path)]


def test_a_shorter_recording_does_not_go_on_with_an_older_one(tmp_path: Path) -> None:
    path, source = tmp_path / "run.aedat", tmp_path / "source.aedat4"
    span = 1 << 31
    long = make_events([5, span + 9], [1, 2], [1, 2], [1, 0])
    info = StreamInfo(346, 260, camera="eye")
    for target, events in ((path, long), (source, long[:1]), (tmp_path / "two.aedat4", long)):
        sink = files.recorder_for(target)
        sink.open([info])
        sink.write(EventPacket(0, 0, 0, 346, 260, events))
        sink.close()
    before = {one: one.read_bytes() for one in tmp_path.iterdir()}
    says = r"run-001\.aedat of an earlier recording would mix"
    with pytest.raises(EvsError, match=says):
        files.recorder_for(path).open([info])
    with pytest.raises(EvsError, match=says):
        files.convert(source, path)
    # and what a conversion would replace is not only its target
    with pytest.raises(EvsError, match=r"run-001\.aedat already exists"):
        files.convert(tmp_path / "two.aedat4", path)
    assert {one: one.read_bytes() for one in tmp_path.iterdir()} == before
    # another recording that only has such a name is nobody's part
    (tmp_path / "run-001.aedat").write_bytes((tmp_path / "run.aedat").read_bytes())
    files.convert(source, path)
    assert evs.read(path).tobytes() == long[:1].tobytes()
