"""`evs characterise` end to end: table, JSON, picture, and what it refuses."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evs.drivers.pictures.chart import HEADING_PX
from evs.emulator.sensor import SensorParameters
from evs.launch.main import main
from evs.msgs import EvsError
from evs.msgs.pictures import OFF_RGB, ON_RGB
from evs_lab.characterise import STEPS, characterise
from evs_lab.characterise.chart_page import CHART_PX, COLUMNS

SENSOR = """\
width = 40
height = 30
pos_thres = 0.2
neg_thres = 0.25
sigma_thres = 0.02
dark_lux = 0.1
cutoff_hz = 300.0
leak_rate_hz = 0.2
shot_noise_rate_hz = 0.5
refractory_period_s = 3e-4

[readout]
bandwidth_mevs = 1.5
fifo = 512
"""

QUANTITIES = {
    *("ON threshold", "ON threshold, sigma over pixels"),
    *("OFF threshold", "OFF threshold, sigma over pixels", "dead pixels"),
    *("ON threshold, Weber contrast", "OFF threshold, Weber contrast"),
    *("ON ramp threshold, RCT", "ON ramp non-uniformity, RCTNU"),
    *("OFF ramp threshold, RCT", "OFF ramp non-uniformity, RCTNU"),
    *("least illuminance", "dynamic range", "latency", "jitter", "bandwidth, -3 dB"),
    *("shot noise rate", "leak rate", "hot pixels", "refractory period", "peak rate"),
}


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(SENSOR)
    return path


def test_numbers_and_picture(
    sensor: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers, picture = tmp_path / "mine.json", tmp_path / "mine.png"
    words = ["characterise", str(sensor), "sensor.neg_thres=0.3", "--seed", "3"]
    assert main([*words, "--json", str(numbers), "--picture", str(picture)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    lines = said.out.splitlines()
    assert lines[0] == "mine: 1,200 pixels"
    assert lines[1].split() == ["quantity", "at", "lux", "measured", "error", "set", "difference"]
    named = {line.split("  ")[0] for line in lines[2:]} - {""}
    assert named == QUANTITIES

    told = json.loads(numbers.read_text())
    assert set(told) == {"sensor", "pixels", "seed", "results", "curves"}
    assert (told["sensor"]["name"], told["sensor"]["neg_thres"]) == ("mine", 0.3)
    assert (told["pixels"], told["seed"]) == (1200, 3)
    assert len(told["results"]) == len(lines) - 2
    keys = {"quantity", "unit", "measured", "error", "set", "lux", "note", "deviation"}
    assert all(set(result) == keys for result in told["results"])
    assert {result["quantity"] for result in told["results"]} == QUANTITIES
    by_name = {result["quantity"]: result for result in told["results"]}
    # 1,200 pixels: within five standard errors of what was set
    for name in ("ON threshold", "OFF threshold", "refractory period", "peak rate"):
        result = by_name[name]
        assert abs(result["measured"] - result["set"]) < 5.0 * result["error"], result
    assert by_name["OFF threshold"]["set"] == 0.3
    assert by_name["peak rate"]["set"] == 1.5e6
    assert set(told["curves"]) == {
        *("thresholds", "ramp", "dynamic_range", "latency", "bandwidth"),
        *("background", "refractory", "peak_rate"),
    }
    curve = told["curves"]["thresholds"]["on"]
    assert len(curve["contrast"]) == len(curve["share"]) > 20

    with Image.open(picture) as image:
        page = np.asarray(image.convert("RGB"))
    width, height = CHART_PX
    assert page.shape == (HEADING_PX + 3 * height, COLUMNS * width, 3)
    # each of the nine charts has something on it
    for k in range(9):
        row, column = HEADING_PX + k // 3 * height, k % 3 * width
        part = page[row : row + height, column : column + width]
        assert np.count_nonzero((part < 128).all(2)) > 200, k
        assert np.count_nonzero(part.max(2) - part.min(2) > 60) > 100, k
    for colour in (ON_RGB, OFF_RGB):
        near = np.abs(page.astype(int) - np.array(colour)).max(2) < 24  # one of 256 colours
        assert np.count_nonzero(near) > 100


@pytest.mark.parametrize("option", ["--json", pytest.param("--quiet", marks=pytest.mark.slow)])
def test_json_alone_is_on_stdout(
    option: str, sensor: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["characterise", str(sensor), "--pixels", "100", option]) == 0
    output = capsys.readouterr()
    if option == "--json":
        assert json.loads(output.out)["pixels"] <= 100
    else:
        assert (output.out, output.err) == ("", "")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["davis364"], "no sensor 'davis364'; there is: davis346"),
        (["none.toml"], "no sensor file none.toml"),
        ([], "the following arguments are required: SENSOR, key=value"),
        (["davis346", "ideal"], "one sensor is measured at a time, given: 'davis346', 'ideal'"),
        (["sensor.cutoff_hz=3"], "given: none"),
        (["ideal", "sensor.cutof_hz=3"], "at sensor.cutof_hz: unknown key; nearest known:"),
        (["ideal", "sensor.cutoff_hz=-3"], "sensor.cutoff_hz is -3"),
        (["ideal", "render.spp=4"], "render.spp has no meaning for a sensor alone"),
        (["ideal", "--pixels", "3"], "3 pixels are too few to measure"),
        (["ideal", "--pixels", "0"], "0 pixels are too few to measure"),
        (["ideal", "--picture", "x.jpg"], "no picture format '.jpg'"),
        (["ideal", "--picture", "x.gif"], "--picture is 'x.gif': end it in .png"),
        (["ideal", "--json", "nowhere/x.json"], "there is no folder 'nowhere'"),
        (["ideal", "--seed", "three"], "at seed: expected an integer"),
    ],
)
def test_bad_words_are_one_line(
    words: list[str],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["characterise", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert says in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_sensor_without_any_term(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["characterise", "ideal", "--pixels", "400"]) == 0
    out = capsys.readouterr().out
    assert "over 31 kHz" in out
    assert "no limit up to" in out


@pytest.mark.parametrize(
    "terms",
    [
        {"dead_pixel_fraction": 1.0},
        {"hot_leak_median_hz": 1000.0, "hot_leak_cov_decades": 0.0},
        {"shot_noise_rate_hz": 20_000.0},
        {"pos_thres": 20.0, "neg_thres": 20.0},
        {"white_lux": 1e9},
        {"exposure_dn": 1e-6},
        {"cutoff_hz": 0.01, "dim_lux": 0.0},
        {"highpass_hz": 1e5},
        {"refractory_period_s": 100.0},
        {"sigma_thres": 5.0},
        {"leak_rate_hz": 1e4},
    ],
    ids=lambda terms: "+".join(terms),
)
@pytest.mark.slow
def test_whatever_the_sensor_the_bench_comes_to_an_end(terms: dict[str, float]) -> None:
    steps: list[str] = []
    values = {"pos_thres": 0.2, "neg_thres": 0.2, "sigma_thres": 0.02, **terms}
    found = characterise(SensorParameters("odd", 16, 12, **values), threads=1, moved=steps.append)
    assert len(steps) == STEPS
    for result in found.results():
        assert math.isfinite(result.measured) or result.note, result
    json.dumps(found.plain(), allow_nan=False)


def test_too_few_pixels_are_refused() -> None:
    with pytest.raises(EvsError, match="too few to measure"):
        characterise(SensorParameters("small", 16, 12, 0.2, 0.2), pixels=10)


def test_charts_without_matplotlib_name_the_extra(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["characterise", "ideal", "--picture", "x.png"]) == 2
    assert "pip install 'evs[plot]'" in capsys.readouterr().err
