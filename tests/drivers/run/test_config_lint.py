"""Settings of a sensor that are legal but hardly meant: which line a user gets for which."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.run.config import load, make_sink
from evs.drivers.run.config_lint import lint
from evs.drivers.run.run import run
from evs.emulator import World
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import preset_names, resolve_sensor

SCENE = Path(__file__).parents[3] / "config" / "scenes" / "pendulum.xml"


def of(preset: str = "ideal", model: str = "plain", **given: Any) -> list[str]:
    sensor = asdict(resolve_sensor(SensorConfig(preset, **given)))
    return lint("eye", {"sensor": sensor, "model": {"name": model}})


@pytest.mark.parametrize("preset", preset_names())
def test_nobody_doubts_a_preset(preset: str) -> None:
    assert of(preset) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pos_thres": 0.001}, "sensor.pos_thres is 0.001, so black to white is 5,541 events"),
        ({"neg_thres": 0.005}, "sensor.neg_thres is 0.005, so"),
        ({"pos_thres": 0.009, "neg_thres": 0.009}, "sensor.pos_thres and neg_thres are 0.009"),
        ({"sigma_thres": 0.2}, "sigma_thres is 0.2 and pos_thres and neg_thres are 0.2: 17 % of"),
        ({"refractory_period_s": 100.0}, "after each event a pixel is blind for 100 s"),
        ({"cutoff_hz": 0.01}, "sensor.cutoff_hz is 0.01: a pixel follows the light 16 s late"),
        ({"follower_hz": 0.1}, "sensor.follower_hz is 0.1: a pixel follows the light 1.6 s late"),
    ],
)  # fmt: skip
def test_one_line_names_the_key(given: dict[str, float], said: str) -> None:
    (line,) = of(**given)
    assert line.startswith("camera 'eye': ")
    assert said in line


def test_a_network_takes_only_the_thresholds() -> None:
    assert of(model="evsnet", sigma_thres=1.0, cutoff_hz=0.01, refractory_period_s=9.0) == []
    assert len(of(model="evsnet", pos_thres=0.005)) == 1


def test_a_run_says_it_once_and_reports_it(tmp_path: Path) -> None:
    config = load(
        tables={
            "scene": {"file": str(SCENE), "camera": "front"},
            "sensor": {"preset": "ideal", "width": 8, "height": 6, "cutoff_hz": 0.01},
            "record": str(tmp_path / "run.npz"),
        }
    )
    said: list[str] = []
    sinks = [make_sink(sink) for sink in config.sinks()]
    report = run(World.from_config(config.emulation()), sinks, 0.005, warn=said.append)
    assert said == ["camera 'camera': " + of(cutoff_hz=0.01)[0].removeprefix("camera 'eye': ")]
    assert report.warnings == said
