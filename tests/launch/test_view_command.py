"""`evs view` on recorded files: what it writes, what it says, what it refuses."""

import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evs.drivers.files import read, recorder_for
from evs.launch.main import main
from evs.msgs import EventPacket, StreamInfo, empty_events, make_events
from evs.msgs.pictures import OFF_RGB, ON_RGB

WIDTH, HEIGHT = 32, 24


def record(path: Path, seconds: float = 1.0, empty: bool = False) -> Path:
    """An event every 10 ms, ON then OFF in turns, one column further each time."""
    recorder = recorder_for(path)
    recorder.open([StreamInfo(WIDTH, HEIGHT, sensor="ideal")])
    for step in range(1, round(seconds * 100) + 1):
        t_us = step * 10_000
        one = make_events([t_us], [step % WIDTH], [step % HEIGHT], [step % 2])
        events = empty_events() if empty else one
        recorder.write(EventPacket(step - 1, t_us - 10_000, t_us, WIDTH, HEIGHT, events))
    recorder.close()
    return path


def count(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int(np.all(picture == np.array(colour, np.uint8), axis=2).sum())


@pytest.mark.parametrize("suffix", [".aedat4", ".npz"])
def test_without_a_name_the_picture_is_beside_the_file(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / f"run{suffix}")
    assert main(["view", str(path), "--scale", "10"]) == 0
    said = capsys.readouterr()
    assert f"run{suffix}.png: 3 instants (0.248, 0.496, 0.743 s)" in said.out
    assert said.err == ""
    with Image.open(f"{path}.png") as image:
        page = np.asarray(image)
    # 10 ms windows: steps 25, 50 and 75 are one event each, 10 x 10 px, beside the legend's square
    extra = count(page, ON_RGB) - count(page, OFF_RGB)
    assert extra == (2 - 1) * 10 * 10


def test_gif_lasts_as_long_as_the_speed_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, film = record(tmp_path / "run.npz"), tmp_path / "film.gif"
    assert main(["view", str(path), "-o", str(film), "--scale", "1"]) == 0
    # the first event is at 10 ms, so that the film begins at 9 ms
    assert "100 frames, 4.00 s at 1/4 real time" in capsys.readouterr().out
    with Image.open(film) as image:
        assert image.n_frames == 100
        total_ms = 0
        for index in range(image.n_frames):
            image.seek(index)
            total_ms += image.info["duration"]
    assert total_ms == 4000


def test_start_stop_speed_fps_and_window(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, film = record(tmp_path / "run.npz"), tmp_path / "film.gif"
    # the first event is at 10 ms
    words = [
        "--start",
        "0.191",
        "--stop",
        "0.391",
        "--speed",
        "0.1",
        "--fps",
        "10",
        "--window",
        "30",
    ]
    assert main(["view", str(path), "-o", str(film), "--scale", "1", *words]) == 0
    assert "20 frames, 2.00 s at 1/10 real time" in capsys.readouterr().out
    with Image.open(film) as image:
        assert image.n_frames == 20
        image.seek(19)
        last = np.asarray(image.convert("RGB"))[:HEIGHT]
    # 0.37 < t <= 0.4: steps 38, 39 and 40, of which 39 is ON
    assert (count(last, ON_RGB), count(last, OFF_RGB)) == (1, 2)


def test_a_recording_in_unix_time_shows_the_same_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []
    for name, later_us in (("a.npz", 0), ("b.npz", 1_690_000_000_000_000)):
        path = record(tmp_path / "plain.npz")
        arrays = dict(np.load(path))
        arrays["t"] += later_us
        path = tmp_path / name
        np.savez(path, **arrays)
        pictures = [tmp_path / f"{name}.png", tmp_path / f"{name}.gif"]
        for picture in pictures:
            words = ["--start", "0.05", "--stop", "0.25", "--scale", "1"]
            assert main(["view", str(path), "-o", str(picture), *words]) == 0
        made.append([picture.read_bytes() for picture in pictures][1:])
        with Image.open(pictures[0]) as image:
            made[-1].append(np.asarray(image)[:HEIGHT].tobytes())
    assert made[0] == made[1]
    assert "3 instants (0.1, 0.15, 0.2 s)" in capsys.readouterr().out


def test_events_far_apart_on_the_sensor_make_no_huge_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "far.csv"
    path.write_text("t,x,y,p\n1,0,0,1\n2,16000,16000,0\n")
    for name in ("far.png", "far.gif"):
        tracemalloc.start()
        assert main(["view", str(path), "-o", str(tmp_path / name)]) == 2
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < 50 << 20
        assert "the picture would be" in capsys.readouterr().err
    tracemalloc.start()
    assert "a pixel for 4 x 4" in read(path)._repr_html_()
    assert tracemalloc.get_traced_memory()[1] < 400 << 20
    tracemalloc.stop()


def test_mp4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, film = record(tmp_path / "run.npz", 0.2), tmp_path / "film.mp4"
    assert main(["view", str(path), "-o", str(film)]) == 0
    assert "20 frames, 0.80 s" in capsys.readouterr().out
    assert film.read_bytes()[4:8] == b"ftyp"


def test_mp4_without_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    path = record(tmp_path / "run.npz", 0.1)
    assert main(["view", str(path), "-o", str(tmp_path / "film.mp4")]) == 2
    assert "pip install 'evs[video]'" in capsys.readouterr().err
    assert not (tmp_path / "film.mp4").exists()


@pytest.mark.parametrize("name", ["out.png", "out.gif", "out.mp4"])
@pytest.mark.parametrize("suffix", [".aedat4", ".npz"])
def test_a_recording_without_events(
    tmp_path: Path, name: str, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / f"run{suffix}", 0.1, empty=True)
    assert main(["view", str(path), "-o", str(tmp_path / name)]) == 0
    assert "has no events" in capsys.readouterr().err
    assert (tmp_path / name).stat().st_size > 0


def test_a_torn_file_is_shown_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / "run.aedat4")
    path.write_bytes(path.read_bytes()[:-700])
    assert main(["view", str(path), "--scale", "1"]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("evs: warning:")
    assert said.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "out.jpg"], "no picture format '.jpg'; there is: "),
        (["-o", "out"], "no picture format 'out'; there is: "),
        (["--scale", "0"], "--scale is 0: give a whole number from 1 to 64"),
        (["--scale", "99"], "--scale is 99"),
        (["--scale", "two"], "--scale"),
        (["--fps", "0"], "fps is 0"),
        (["--fps", "nan"], "fps is nan"),
        (["--speed", "-1"], "speed is -1"),
        (["--window", "0"], "window is 0 us"),
        (["--window", "inf"], "--window is inf"),
        (["--start", "nan"], "--start is nan"),
        (["--start", "2"], "lasts 0.991 s from its first event on"),
        (["--stop", "0"], "lasts 0.991 s from its first event on"),
        (["--start", "0.5", "--stop", "0.4"], "stop must be after start"),
        (["-o", "film.gif", "--fps", "60"], "at most 50 fps"),
    ],
)
def test_bad_words_are_one_line(
    tmp_path: Path,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record(tmp_path / "run.npz")
    monkeypatch.chdir(tmp_path)
    assert main(["view", "run.npz", *words]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]


def test_no_such_file_names_its_neighbours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "run.npz", 0.1)
    assert main(["view", str(tmp_path / "ran.npz")]) == 2
    assert "run.npz" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
@pytest.mark.parametrize(
    ("bad_s", "fix"), [(1e9, "--stop 0.991000"), (-1e9, "--start 1000000000.010999")]
)
def test_one_bad_stamp_makes_no_endless_film(
    suffix: str, bad_s: float, fix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, film = tmp_path / "run.npz", tmp_path / f"film{suffix}"
    t = np.sort(np.append(np.arange(1, 101) * 10_000, round(bad_s * 1e6)))
    np.savez(path, t=t, x=t % 7 % WIDTH, y=t % 5 % HEIGHT, p=t % 2)
    assert main(["view", str(path), "-o", str(film), "--speed", "1"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"so give {fix};" in said
    assert not film.exists()
    # what it asks for does it
    assert main(["view", str(path), "-o", str(film), "--speed", "10", *fix.split()]) == 0
