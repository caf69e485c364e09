"""Recordings by name: what exists, what does not, and evs info and evs play on them."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.bus.address import free_address
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.drivers.files.npz import NpzRecorder
from evs.launch.main import main
from evs.launch.support import reinvoke
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events

STREAM = StreamInfo(346, 260, camera="eye", sensor="davis346", seed=9, versions={"evs": "0.1.0"})


def events() -> Events:
    t = np.arange(1, 30_001, 3)
    return make_events(t, t % 346, t % 260, t % 2)


@pytest.fixture(params=["run.aedat4", "run.npz", "run.aedat", "run.aedat3", "run.csv"])
def recording(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / str(request.param)
    sink = files.recorder_for(path)
    sink.open([STREAM])
    for k in range(10):
        part = events()[1000 * k : 1000 * k + 1000]
        sink.write(EventPacket(k, 0, 0, 346, 260, part, "eye"))
    sink.close()
    return path


def test_the_ending_chooses_the_recorder(tmp_path: Path) -> None:
    assert isinstance(files.recorder_for(tmp_path / "a.aedat4", "zstd"), Aedat4Recorder)
    assert isinstance(files.recorder_for(str(tmp_path / "A.NPZ")), NpzRecorder)
    for name in ("a.bagpipe", "a", "aedat4"):
        for use in (files.recorder_for, files.read, files.summary, files.repair, files.stream_of):
            with pytest.raises(EvsError, match=r"names end in \.aedat4"):
                use(tmp_path / name)


@pytest.mark.parametrize("suffix", [".aedat4", ".npz"])
def test_a_missing_file_names_its_neighbours(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(EvsError, match="the folder has no recordings"):
        files.read(tmp_path / f"run{suffix}")
    (tmp_path / "ran.aedat4").touch()
    (tmp_path / "other.npz").touch()
    with pytest.raises(EvsError, match=r"the folder has: \w+\.\w+, \w+\.\w+$"):
        files.read(tmp_path / f"run{suffix}")
    with pytest.raises(EvsError, match="there is no folder"):
        files.read(tmp_path / "no" / f"run{suffix}")
    (tmp_path / f"dir{suffix}").mkdir()
    with pytest.raises(EvsError, match="is a folder"):
        files.read(tmp_path / f"dir{suffix}")
    with pytest.raises(EvsError, match="File name too long"):
        files.read(tmp_path / ("x" * 300 + suffix))


def test_info_tells_everything(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(recording)]) == 0
    said = capsys.readouterr().out
    for part in ("346 x 260 px", "eye", "davis346", "10,000 (5,000 ON, 5,000 OFF)", "evs 0.1.0"):
        assert part in said
    assert "0.029997 s, from 1 to 29,998 us" in said
    assert "333,367 per second" in said
    assert "torn" not in said
    assert main(["info", "--json", str(recording)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["events"], told["on"], told["torn_at"]) == (10_000, 5000, None)
    assert told["stream"]["seed"] == 9
    assert told["rate_hz"] == pytest.approx(10_000 / 0.029997)
    assert told["table"] == (recording.suffix == ".aedat4")


def test_info_repairs(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--repair", str(recording)]) == 0
    assert capsys.readouterr().out.startswith(f"{recording} needs no repair\n")
    if recording.suffix == ".npz":
        return
    size = recording.stat().st_size
    with recording.open("ab") as file:
        file.write(b"torn" * 3)
    assert main(["info", str(recording)]) == 0
    said = capsys.readouterr().out
    mend = reinvoke.command("info", "--repair", str(recording))
    assert f"12 bytes at offset {size:,}; {mend} cuts them" in said
    assert main(["info", "--repair", "--json", str(recording)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["repaired"], told["cut_bytes"], told["torn_at"]) == (True, 12, None)
    assert recording.stat().st_size == size


def test_info_of_nothing_is_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.aedat4").write_bytes(b"nothing")
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    for name in ("no.aedat4", "bad.aedat4", "bad.npz", "a.bagpipe"):
        for command in ("info", "play"):
            assert main([command, str(tmp_path / name)]) == 2
            caught = capsys.readouterr()
            assert caught.out == ""
            assert caught.err.startswith("evs: ")
            assert caught.err.count("\n") == 1


@pytest.mark.integration
def test_play_gives_a_subscriber_every_event(recording: Path) -> None:
    from evs.drivers.bus import subscribe

    address = free_address()
    got: list[EventPacket] = []
    with subscribe(address, timeout_s=20.0) as stream:
        listener = threading.Thread(target=lambda: got.extend(stream))
        listener.start()
        words = [str(recording), "--address", address, "--fast", "--wait-for", "1"]
        played = subprocess.run(
            [sys.executable, "-c", "from evs.launch.main import main; main()", "play", *words],
            capture_output=True,
            text=True,
            check=True,
        )
        listener.join(20.0)
        assert not listener.is_alive()
    assert "10,000 events" in played.stdout
    assert np.concatenate([packet.events["t"] for packet in got]).tolist() == events()["t"].tolist()
    assert [packet.seq for packet in got] == list(range(len(got)))
    assert {packet.camera for packet in got} == {"eye"}


def test_play_keeps_the_pace_and_tells_of_a_torn_tail(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from evs.drivers import clock

    if recording.suffix == ".aedat4":
        with recording.open("ab") as file:
            file.write(b"torn")
    waited: list[tuple[float, int]] = []
    monkeypatch.setattr(
        clock.Pacer, "wait_until", lambda self, t_us: waited.append((self.speed, t_us))
    )
    address = free_address()
    assert main(["play", str(recording), "--address", address, "--speed", "0.5"]) == 0
    assert {speed for speed, _ in waited} == {0.5}
    times = [t_us for _, t_us in waited]
    assert times == sorted(times)
    assert times[-1] == 30_000
    said = capsys.readouterr()
    assert "10,000 events" in said.out
    assert ("evs: warning:" in said.err) == (recording.suffix == ".aedat4")


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf"])
def test_play_refuses_an_impossible_speed(
    recording: Path, capsys: pytest.CaptureFixture[str], speed: str
) -> None:
    assert main(["play", str(recording), "--speed", speed]) == 2
    assert "--speed" in capsys.readouterr().err
