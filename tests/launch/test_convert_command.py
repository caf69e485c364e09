"""evs convert: between all formats, nothing lost silently, nothing written that does not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files import convert
from evs.drivers.files.integrity import TornTailWarning
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events
from reference.recordings import events, record


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = record(tmp_path / "run.aedat4", "aedat4")
    assert main(["convert", str(given), str(tmp_path / "run.csv")]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{tmp_path}/run.csv: 3,000 events, 0.04 MB\nnext:\n  ")
    assert said.err == ""
    words = ["convert", str(given), str(tmp_path / "b.aedat"), "--format", "aedat3", "--quiet"]
    assert main(words) == 0
    assert capsys.readouterr().out == ""
    assert files.summary(tmp_path / "b.aedat").format == "aedat3"
    assert main(["convert", str(given), str(tmp_path / "c.aedat4"), "--compression", "zstd"]) == 0
    assert files.summary(tmp_path / "c.aedat4").compression == "zstd"


def test_frames_and_imu_go_along_or_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = record(tmp_path / "run.aedat4", "aedat4", beside=True)
    made = tmp_path / "run.npz"
    assert main(["convert", str(given), str(made)]) == 0
    assert "3,000 events, 1 frames, 4 IMU samples" in capsys.readouterr().out
    assert len(files.read(made).frames) == 1
    assert len(files.read(made).imu) == 4
    made = tmp_path / "run.csv"
    assert main(["convert", str(given), str(made)]) == 2
    said = capsys.readouterr().err
    assert "cannot hold the intensity frames and IMU samples of" in said
    assert "--events-only" in said
    assert not made.exists()
    assert main(["convert", str(given), str(made), "--events-only"]) == 0
    assert "left out: 1 intensity frames, 4 IMU samples" in capsys.readouterr().out
    assert files.read(made).tobytes() == events().tobytes()


def test_labels_go_along_or_are_refused(tmp_path: Path) -> None:
    given = tmp_path / "a.npz"
    t = np.arange(1, 3001)
    columns = {"t": t, "x": t % 9, "y": t % 7, "p": t % 2}
    cause, geom = (t % 3).astype(np.uint8), (t % 50).astype(np.int32)
    np.savez(given, **columns, cause=cause, geom_id=geom)
    with pytest.raises(EvsError, match="cannot hold the labels"):
        convert(given, tmp_path / "a.aedat4")
    convert(given, tmp_path / "b.npz")
    labels = files.read(tmp_path / "b.npz").labels
    assert labels is not None
    assert labels["geom_id"].tolist() == geom.tolist()
    done = convert(given, tmp_path / "a.aedat4", events_only=True)
    assert done.left_out == {"labels": 3000}


@pytest.mark.parametrize(
    ("target", "size", "first_us", "said"),
    [
        ("a.aedat", (1025, 4), 5, "AEDAT2 holds at most 1024 x 512 px"),
        ("a.aedat", (4, 513), 5, "AEDAT2 holds at most 1024 x 512 px"),
        ("a.aedat", (4, 4), -1, "cannot record an event at -1 us"),
        ("a.aedat3", (4, 4), -1, "AEDAT3.1 holds 0 ..."),
    ],
)
def test_what_does_not_fit_leaves_everything_as_it_was(
    tmp_path: Path, target: str, size: tuple[int, int], first_us: int, said: str
) -> None:
    given = tmp_path / "in.npz"
    sink = files.recorder_for(given)
    sink.open([StreamInfo(*size)])
    sink.write(EventPacket(0, 0, 0, *size, make_events([first_us], [1], [1], [1])))
    sink.close()
    (tmp_path / target).write_text("precious")
    with pytest.raises(EvsError, match=said):
        convert(given, tmp_path / target)
    assert (tmp_path / target).read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["in.npz", target])


def test_the_source_cannot_be_the_target(tmp_path: Path) -> None:
    given = record(tmp_path / "a.csv", "csv")
    (tmp_path / "link.csv").symlink_to(given)
    for target in (given, tmp_path / "link.csv"):
        with pytest.raises(EvsError, match="is the recording to be converted"):
            convert(given, target)
    with pytest.raises(EvsError, match="there is no folder"):
        convert(given, tmp_path / "no" / "a.npz")
    with pytest.raises(EvsError, match=r"no recording format '\.xyz'"):
        convert(given, tmp_path / "a.xyz")
    (tmp_path / "dir.npz").mkdir()
    with pytest.raises(EvsError, match="it is a folder"):
        convert(given, tmp_path / "dir.npz")


def test_an_error_in_the_middle_leaves_no_half_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = record(tmp_path / "a.csv", "csv")
    before = sorted(tmp_path.iterdir())
    from evs.drivers.files.appending_recorder import AppendingRecorder

    monkeypatch.setattr(
        AppendingRecorder, "_write_events", lambda *_: (_ for _ in ()).throw(EvsError("full"))
    )
    with pytest.raises(EvsError, match="full"):
        convert(given, tmp_path / "b.aedat")
    assert sorted(tmp_path.iterdir()) == before


def test_a_damaged_source_is_converted_as_far_as_it_is_whole(tmp_path: Path) -> None:
    given = record(tmp_path / "a.aedat", "aedat2")
    with given.open("ab") as file:
        file.write(b"torn")
    with pytest.warns(TornTailWarning):
        convert(given, tmp_path / "b.npz")
    assert files.read(tmp_path / "b.npz").tobytes() == events().tobytes()


def test_a_recording_of_many_files_comes_out_whole(tmp_path: Path) -> None:
    given = tmp_path / "a.csv"
    wrap = 1 << 31
    given.write_text(f"%geometry:9,9\n{wrap - 1},1,1,1\n{wrap},2,2,1\n")
    done = convert(given, tmp_path / "b.aedat")
    assert [path.name for path in done.files] == ["b-001.aedat", "b.aedat"]
    alone = [files.read(path, single=True)["t"].tolist() for path in done.files]
    assert alone == [[wrap], [wrap - 1]]
    assert files.read(tmp_path / "b.aedat")["t"].tolist() == [wrap - 1, wrap]
