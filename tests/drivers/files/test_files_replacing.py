"""No program replaces a file that is there, unless it is told to."""

from __future__ import annotations

from pathlib import Path

import pytest

from evs.drivers.clock import StopWatch
from evs.drivers.lockstep.segments import Segments
from evs.drivers.run.config import PIPELINES
from evs.drivers.run.launcher.node import again
from evs.drivers.sink_config import SinkConfig
from evs.launch.main import main
from evs.msgs import EvsError, StreamInfo

SCENE = str(PIPELINES.parent / "scenes" / "pendulum.xml")
SMALL = [SCENE, "sensor.width=16", "sensor.height=12", "--duration", "0.01", "render.spp=1"]
HERE = "already exists: use --force"
INFOS = [StreamInfo(16, 12, camera="left"), StreamInfo(16, 12, camera="right")]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of a refusal, after which every file is as it was."""
    capsys.readouterr()
    before = {file: file.read_bytes() for file in Path().iterdir()}
    assert main(words) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert {file: file.read_bytes() for file in Path().iterdir()} == before
    return told.err


def test_a_recording_is_replaced_on_request_alone(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["emulate", *SMALL, "--quiet"]
    for ending, kind in (("aedat4", "aedat4"), ("npz", "npz"), ("csv", "csv"), ("raw", "evt3")):
        sink = [f"sink.0.type={kind}", f"sink.0.file=r.{ending}"]
        Path(f"r.{ending}").write_text("kept")
        assert HERE in refused([*words, *sink], capsys)
        assert main([*words, *sink, "sink.0.overwrite=true"]) == 0
        assert HERE in refused([*words, "--record", f"r.{ending}"], capsys)
        assert main([*words, "--record", f"r.{ending}", "--force"]) == 0
        assert main([*words, "--record", f"r.{ending}", "overwrite=true"]) == 0


def test_convert_and_render_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["emulate", *SMALL, "--quiet", "--record", "run.aedat4"]) == 0
    for words in (
        ["convert", "run.aedat4", "out.csv", "--quiet"],
        ["render", *SMALL, "--quiet", "-o", "out.npz"],
        ["render", *SMALL, "--quiet", "-o", "new.npz", "--preview", "out.png"],
    ):
        file = next(Path(word) for word in words if word.startswith("out."))
        file.write_text("kept")
        assert HERE in refused(words, capsys)
        assert main([*words, "--force"]) == 0
        assert file.read_bytes() != b"kept"


def test_a_recorder_of_a_stream_too(capsys: pytest.CaptureFixture[str]) -> None:
    Path("run.aedat4").write_text("kept")
    assert HERE in refused(["record", "tcp://127.0.0.1:5999", "run.aedat4"], capsys)


def test_what_starts_again_records_beside() -> None:
    words = ["emulate", *SMALL, "--quiet", "--record", "run.aedat4"]
    for _ in range(3):
        assert main(list(again(("evs", *words))[1:])) == 0
    names = ["run-1.aedat4", "run-2.aedat4", "run.aedat4"]
    assert sorted(file.name for file in Path().glob("*.aedat4")) == names
    assert all(Path(f"{name}.report.json").is_file() for name in names)


def test_only_what_records_is_told_that_it_starts_again() -> None:
    serve, connect = ("evs", "loop", "pencil", "--serve", "a"), ("evs", "loop", "x", "--connect")
    assert again(serve) == (*serve, "beside=true")
    assert again(("evs", "record", "a", "f")) == ("evs", "record", "a", "f", "--beside")
    for run in (connect, ("evs", "echo", "a"), ("python", "emulate"), ("evs",)):
        assert again(run) == run


def segments(auxiliary: bool = False, overwrite: bool | None = None) -> Segments:
    table = SinkConfig.of(type="npz", file="run.npz", overwrite=overwrite)
    return Segments([table], StopWatch(), lambda _line: None, auxiliary)


@pytest.mark.parametrize("there", ["run-left.npz", "run-right-episode-002.npz"])
def test_a_loop_replaces_no_recording_of_any_camera_or_episode(there: str) -> None:
    Path(there).write_text("kept")
    with pytest.raises(EvsError, match=rf"'{there}' {HERE}"):
        segments().open(INFOS)
    assert [file.name for file in Path().iterdir()] == [there]
    kept = segments(overwrite=True)
    kept.open(INFOS)
    assert kept.close() is None


def test_a_loop_that_starts_again_records_beside() -> None:
    Path("run-right.npz").write_text("kept")
    kept = segments(auxiliary=True)
    kept.open(INFOS)
    assert kept.files == ["run-left-1.npz", "run-right-1.npz"]
    assert kept.close() is None
