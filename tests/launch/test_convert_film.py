"""evs convert of a film: what it reports, what it keeps, and what it refuses."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import evs
from evs.drivers.films.run import emulate_film
from evs.launch.main import main
from reference.foreign_films import ffmpeg, lossless, texture
from reference.memory import PEAK

SMALL = ["sensor.width=64", "sensor.height=48", "--quiet"]


@pytest.fixture
def film(tmp_path: Path) -> str:
    """Twenty frames in 0.2 s."""
    return str(lossless(tmp_path / "film.mkv", texture(20), 100))


def test_the_summary_and_the_report(
    film: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "run.aedat4"
    assert main(["convert", film, str(target), *SMALL[:2], "--seed", "7", "--substeps", "4"]) == 0
    out = capsys.readouterr().out
    assert "0.19 s in 76 ticks" in out
    assert f"info {target}" in out
    report = json.loads((tmp_path / "run.aedat4.report.json").read_text())
    events = evs.read(target)
    assert (report["ended"], report["ticks"], report["events"]) == ("complete", 76, len(events))
    assert report["seed"] == 7
    assert report["config"]["film"]["substeps"] == 4
    assert report["cameras"][0]["plan"]["contents"] == {"film": film}
    assert {"render", "sensor", "sink"} <= set(report["stage_ms"])
    assert events.stream.config["sensor"]["pos_thres"] > 0


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_keeps_what_was_recorded(
    film: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, code: int, word: str
) -> None:
    def interrupted(*args: Any, progress: Any, **options: Any) -> Any:
        def after_half(share: float) -> None:
            if share > 0.5:
                signal.raise_signal(number)

        return emulate_film(*args, progress=after_half, **options)

    monkeypatch.setattr("evs.drivers.films.run.emulate_film", interrupted)
    target = tmp_path / "half.aedat4"
    assert main(["convert", film, str(target), *SMALL]) == code
    report = json.loads((tmp_path / "half.aedat4.report.json").read_text())
    assert report["ended"].startswith(f"{word} at 0.09 s")
    part = evs.read(target)
    monkeypatch.undo()
    assert main(["convert", film, str(tmp_path / "all.aedat4"), *SMALL]) == 0
    whole = evs.read(tmp_path / "all.aedat4")
    assert 1000 < len(part) < len(whole)
    assert part.tobytes() == whole[: len(part)].tobytes()


def test_a_damaged_frame_ends_it_and_costs_none_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "frames").mkdir()
    for number, frame in enumerate(texture(6)):
        Image.fromarray(frame).save(tmp_path / f"frames/{number}.png")
    assert (
        main(["convert", str(tmp_path / "frames"), str(tmp_path / "a.npz"), "--fps=9", *SMALL]) == 0
    )
    (tmp_path / "frames/4.png").write_bytes(b"no picture")
    words = ["convert", str(tmp_path / "frames"), str(tmp_path / "b.npz"), "--fps=9", *SMALL]
    assert main(words) == 2
    assert "4.png" in capsys.readouterr().err
    whole, part = evs.read(tmp_path / "a.npz"), evs.read(tmp_path / "b.npz")
    until = whole[whole["t"] <= 333_333]
    assert len(until) > 500
    assert part["t"].tobytes() == until["t"].tobytes()


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of an error."""
    assert main(["convert", *words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--fps", "0"], "at film.fps: 0; give more than 0"),
        (["--fps", "x"], "at film.fps: expected a finite number"),
        (["--slowdown", "-1"], "at film.slowdown: -1"),
        (["--substeps", "3"], "at film.substeps: 3; give a power of two"),
        (["--between", "cubic"], "no between 'cubic'"),
        (["--fit", "fill"], "no fit 'fill'"),
        (["--unit", "nits"], "no unit 'nits'"),
        (["--crop", "1,2,3"], "at film.crop: 3 numbers"),
        (["--crop", "60,0,30,30"], "does not lie on the 64 x 48 frames"),
        (["--fit", "exact"], "sensor.width=64 sensor.height=48"),
        (["--sensor", "davis999"], "no sensor 'davis999'"),
        (["sensor.pos_tres=1"], "nearest known: sensor.pos_thres"),
        (["render.spp=4"], "at render.spp: unknown key"),
        (["stray"], "'stray' is not key=value"),
        (["--events-only"], "--events-only is for recordings"),
        (["--start", "keep"], "--start is for recordings"),
        (["--fps", "5", "film.times=a.txt"], "give one"),
        (["film.times=absent.txt"], "cannot read 'absent.txt'"),
        (["model.chunk=4"], "at model.chunk"),
        (["sensor.imu.enabled=true"], "frames do not say how the camera moves"),
        (["--format", "csv", "sensor.aps.enabled=true"], "cannot hold frames"),
        (["model.labels=true"], "only .npz recordings hold labels"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    film: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    target = tmp_path / "run.aedat4"
    assert says in refused([film, str(target), *words], capsys)
    assert not target.exists()
    assert not Path(f"{target}.report.json").exists()


def test_what_is_no_film_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = str(tmp_path / "run.aedat4")
    (tmp_path / "text.mp4").write_text("not a film")
    (tmp_path / "empty").mkdir()
    (tmp_path / "frames").mkdir()
    for name in ("0.png", "1.png"):
        Image.fromarray(texture(1)[0]).save(tmp_path / "frames" / name)
    folder = str(tmp_path / "frames")
    assert "no film" in refused([str(tmp_path / "absent.mp4"), target], capsys)
    assert "as a film" in refused([str(tmp_path / "text.mp4"), target], capsys)
    assert "has no frames" in refused([str(tmp_path / "empty"), target, "--fps=9"], capsys)
    assert "have no times: give --fps" in refused([folder, target], capsys)
    assert "no recording format '.xyz'" in refused([folder, "run.xyz", "--fps=9"], capsys)
    Image.fromarray(texture(1, 32, 24)[0]).save(tmp_path / "frames" / "2.png")
    assert "make all of one size" in refused([folder, target, "--fps=9", *SMALL], capsys)
    Image.fromarray(texture(1)[0]).save(tmp_path / "frames" / "3.jpg")
    assert ".jpg and .png files" in refused([folder, target, "--fps=9", "--force"], capsys)


def test_a_playlist_leads_nowhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file may name others by a protocol; none is followed to a network."""
    text = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n"
    (tmp_path / "film.ts").write_text(text)
    words = [str(tmp_path / "film.ts"), str(tmp_path / "run.npz")]
    assert "film.ts" in refused(words, capsys)


def test_hdr_is_not_taken_for_srgb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coded = ["-c:v", "libx265", "-pix_fmt", "yuv420p10le", "-x265-params", "transfer=smpte2084"]
    path = ffmpeg(tmp_path / "hdr.mp4", texture(4), 100, *coded, "-color_trc", "smpte2084")
    assert "is HDR (PQ), not sRGB" in refused([str(path), str(tmp_path / "a.npz")], capsys)
    words = [str(path), str(tmp_path / "a.npz"), "--unit", "luminance", *SMALL]
    assert main(["convert", *words]) == 0


def test_options_of_films_are_refused_for_recordings(
    film: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = str(tmp_path / "run.aedat4")
    assert main(["convert", film, run, *SMALL]) == 0
    err = refused([run, str(tmp_path / "run.csv"), "--fps", "5"], capsys)
    assert "film.fps is for films and folders of frames" in err
    assert "already exists" in refused([film, run], capsys)


def test_without_the_extra_one_line_names_it(film: str, tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['av'] = None\n"
        "from evs.launch.main import main; sys.exit(main(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", program, "convert", film, str(tmp_path / "run.npz")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == (
        "evs: reading films and frames needs the extra 'video': pip install 'evs[video]'\n"
    )


CONVERT = f"""{PEAK}
from evs.launch.main import main
assert main(["convert", *sys.argv[1:], "--quiet"]) == 0
print(peak_kib())
"""


@pytest.mark.slow
@pytest.mark.extremes
def test_memory_does_not_grow_with_the_film(tmp_path: Path) -> None:
    # 100 and 900 frames of 320 x 240 are 8 and 69 MB
    peaks = []
    for count in (100, 900):
        still = np.repeat(texture(10, 320, 240), count // 10, axis=0)
        path = lossless(tmp_path / f"{count}.mkv", still, 100)
        words = [str(path), str(tmp_path / f"{count}.aedat4")]
        done = subprocess.run(
            [sys.executable, "-c", CONVERT, *words], capture_output=True, text=True, check=True
        )
        peaks.append(int(done.stdout))
    assert peaks[1] - peaks[0] < 40_000


@pytest.mark.integration
def test_a_film_is_converted_without_mujoco(film: str, tmp_path: Path) -> None:
    """To load it takes longer than a short film, and it may not be installed."""
    target = str(tmp_path / "run.aedat4")
    program = (
        "import sys\nsys.modules['mujoco'] = None\nfrom evs.launch.main import main\n"
        f"sys.exit(main(['convert', {film!r}, {target!r}, *{SMALL[:2]}]))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    here = tmp_path / "here.aedat4"
    assert main(["convert", film, str(here), *SMALL]) == 0
    assert here.read_bytes() == Path(target).read_bytes()
