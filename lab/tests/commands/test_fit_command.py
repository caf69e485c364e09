"""`evs fit` end to end: table, file, picture, JSON, and what it refuses."""

from __future__ import annotations

import json
import tomllib
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import evs
from evs.drivers.files import recorder_for
from evs.launch.main import main
from evs.msgs import EventPacket
from reference import lamps

KEYS = {"pos_thres": 0.21, "neg_thres": 0.17, "sigma_thres": 0.02, "leak_rate_hz": 0.5}


def write(path: Path, seen, **info) -> None:
    pixels = evs.Pixels("ideal", size=(seen.width, seen.height))
    recorder = recorder_for(path)
    recorder.open([pixels.info])
    end = int(seen.events["t"][-1])
    recorder.write(EventPacket(0, 0, end, seen.width, seen.height, seen.events, "camera"))
    recorder.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recordings")
    write(path / "cap.npz", lamps.dark(10.0, 1, **KEYS))
    write(path / "ramp.npz", lamps.ramp(1, periods=4, **KEYS))
    (path / "far.csv").write_text("t,x,y,p\n1,0,0,1\n2,16000,16000,0\n")
    return path


def test_a_sensor_file_of_two_recordings(folder: Path, capsys) -> None:
    out, picture, numbers = (folder / name for name in ("mine.toml", "mine.png", "mine.json"))
    words = ["--dark", f"{folder}/cap.npz", "--ramp", f"{folder}/ramp.npz", "--contrast", "4"]
    words += ["--base", "ideal", "-o", str(out), "--picture", str(picture), "--json", str(numbers)]
    assert main(["fit", *words]) == 0
    shown = capsys.readouterr().out
    assert "pos_thres" in shown
    assert "cannot be told from this recording:" in shown
    assert "shot_noise_rate_hz: 0 OFF events" in shown
    rows = shown.partition("the replay\n")[2].splitlines()[1:3]
    for row, name in zip(rows, ("cap.npz", "ramp.npz"), strict=True):
        source, *cells = row.replace(",", "").split()
        events, replayed, share, replayed_share = map(float, cells)
        assert source == name
        assert abs(replayed / events - 1.0) < 0.1
        assert abs(replayed_share - share) <= 0.01
    values = tomllib.loads(out.read_text())
    assert abs(values["pos_thres"] - 0.21) < 0.005
    assert abs(values["leak_rate_hz"] - 0.5) < 0.05
    found = {one["key"]: one for one in json.loads(numbers.read_text())}
    assert found["pos_thres"]["source"] == "ramp.npz"
    assert found["shot_noise_rate_hz"]["value"] is None
    with Image.open(picture) as image:
        assert image.size[0] > 1000
    # the file is a sensor
    assert main(["sensors", str(out)]) == 0


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ([], "nothing to fit"),
        (["--ramp", "{}/ramp.npz"], "give --contrast"),
        (["--ramp", "{}/ramp.npz", "--contrast", "0.5"], "--contrast is 0.5"),
        (["--still", "{}/cap.npz"], "--still-lux"),
        (["{}/none.npz"], "none.npz"),
        (["{}/far.csv"], "16001 x 16001 px, more than any"),
        (["{}/cap.npz", "-o", "mine.txt"], "end it in .toml"),
        (["{}/cap.npz", "--base", "davis364"], "davis346"),
    ],
)
def test_what_it_refuses_is_one_line(folder: Path, capsys, words: list[str], what: str) -> None:
    assert main(["fit", *(word.format(folder) for word in words)]) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1


def test_a_long_pause_takes_no_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "gap.npz"
    random = np.random.default_rng(1)
    t = np.cumsum(random.integers(1, 75, 3000))
    t[1500:] += 10**12
    x, y, p = (random.integers(0, size, len(t)) for size in (64, 48, 2))
    np.savez(path, t=t, x=x, y=y, p=p)
    for words, code in (([str(path)], 0), (["--ramp", str(path), "--contrast", "4"], 2)):
        tracemalloc.start()
        assert main(["fit", *words, "--unit", "us"]) == code
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < 50 << 20
    assert "too long to find the period of the light: give --period" in capsys.readouterr().err
