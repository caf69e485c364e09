"""`evs sensors`: the table, one sensor with its sources, JSON, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from evs.emulator.config import SensorConfig
from evs.emulator.config.sensor import BiasConfig
from evs.emulator.sensor import preset_biases, preset_names, resolve_sensor
from evs.emulator.sensor.presets import DEFAULT, describe_sensor, flat, preset_path, read_sources
from evs.launch.main import main


def told(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["sensors", *words]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return said.out


def refusal(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["sensors", *words]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    return said.err


@pytest.mark.parametrize("name", preset_names())
def test_every_value_of_a_preset_has_its_source_and_every_guess_its_reason(name: str) -> None:
    path = preset_path(name)
    sources = read_sources(path)
    assert sources.about
    told = dict(sources.of)
    nominal = preset_biases(name)
    biases = [] if nominal is None else ["biases.law", *(f"biases.{key}" for key in nominal.values)]
    values = {key for key, _ in flat(resolve_sensor(SensorConfig(name)))}
    assert set(told) <= values | set(biases)
    assert set(biases) <= set(told)
    for key, source in told.items():
        assert source, f"{path}: {key} has no source"
        for guess in source.split("guess:")[1:]:
            assert len(guess.strip()) > 3, f"{path}: {key} is guessed without a reason"
        assert "guess" not in source.replace("guess:", ""), f"{path}: {key}: write `guess: reason`"


def test_comments_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        "# about it,\n# on two lines\n\nwidth = 3 # why\n"
        'log = "a#b"  # not in # quotes\n   # and on\n# no part of it\n'
        "height = 4\n[table.inner] # of no key\nkey = '#' # its own\n  # goes on\n"
    )
    sources = read_sources(path)
    assert sources.about == "about it, on two lines"
    assert sources.of == {
        "width": "why",
        "log": "not in # quotes and on",
        "height": "",
        "table.inner.key": "its own goes on",
    }


def test_the_table_has_every_sensor(capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert [row[0] for row in cells] == ["sensor", "---", *preset_names()]
    assert {len(row) for row in cells} == {len(cells[0])}
    assert all(row[1] for row in cells)
    by_name = {row[0]: row for row in cells}
    assert by_name["imx636"][1:3] == ["1280 x 720", "0.223"]
    assert by_name["ideal"][3:-1] == ["-"] * (len(cells[0]) - 4)
    # and it is the one that the page shows
    page = (Path(__file__).parents[2] / "docs/reference/sensors.md").read_text()
    assert "\n".join(["", *lines, ""]) in page


def test_one_sensor_tells_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    text = told(capsys, "dvxplorer")
    for key, _ in flat(resolve_sensor(SensorConfig("dvxplorer"))):
        assert f"\n  {key} " in text or key == "name" or key.startswith("aps."), key
    assert "\n  imu.rate_hz " in text
    assert "data sheet: half of the pixels see a contrast of 13 %; ln 1.13" in text
    assert "biases.contrastThresholdOn     9 " in text
    assert "*" not in text
    assert max(map(len, text.splitlines())) <= 110


def test_what_a_bias_makes_is_marked(capsys: pytest.CaptureFixture[str]) -> None:
    text = told(capsys, "imx636", "sensor.biases.bias_diff_on=-85", "sensor.width=640")
    marked = [line.split()[0] for line in text.splitlines() if "*" in line]
    assert {"pos_thres", "width", "biases.bias_diff_on"} <= set(marked)
    assert "neg_thres" not in marked
    assert "the preset: 0.223" in text
    assert "-85*" in text


def test_json_is_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    every: list[dict[str, Any]] = json.loads(told(capsys, "--json"))
    assert [sensor["name"] for sensor in every] == preset_names()
    one = json.loads(told(capsys, "davis346", "--json"))
    assert one in every
    resolved = dict(flat(resolve_sensor(SensorConfig("davis346"))))
    values = {key: told["value"] for key, told in one["parameters"].items()}
    assert json.loads(json.dumps(resolved)) == {"name": "davis346"} | resolved | values
    assert {"pos_thres", "dark_lux", "aps.rate_hz", "imu.rate_hz"} <= set(values)
    assert one["biases"]["PrBp_fine"]["nominal"] == 58
    assert one["biases"]["PrBp_fine"]["highest"] == 255


def test_biases_are_told_as_they_act() -> None:
    sensitive = BiasConfig(bias_sensitivity=4)
    biases = describe_sensor(SensorConfig("dvxplorer", biases=sensitive)).biases
    assert {bias.key: bias.value for bias in biases} == {
        "bias_sensitivity": 4,
        "contrastThresholdOn": 2,
        "contrastThresholdOff": 2,
    }


def test_an_own_file_and_what_it_does_not_tell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own.toml"
    own.write_text("width = 20 # mine\nheight = 10\npos_thres = 0.3\nneg_thres = 0.4\n")
    one = json.loads(told(capsys, str(own), "--json"))
    assert one["parameters"]["width"]["source"] == "mine"
    assert one["parameters"]["height"]["source"] == DEFAULT
    assert one["biases"] == {}


def test_refusals(capsys: pytest.CaptureFixture[str]) -> None:
    assert "no sensor 'davis364'; there is: davis346" in refusal(capsys, "davis364")
    assert "give one, then key=value" in refusal(capsys, "davis346", "imx636")
    assert "seed is not a sensor key" in refusal(capsys, "seed=3")
    assert "nearest known: sensor.pos_thres" in refusal(capsys, "sensor.pos_tres=3")
    assert "no bias of sensor davis346 'bias_fo'" in refusal(capsys, "sensor.biases.bias_fo=3")
