"""Settings of a sensor that are legal but hardly meant: which line a user gets for which."""

from __future__ import annotations

import math
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
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
        ({"pos_thres": 0.001},
         "sensor.pos_thres is 0.001, so a change from black to white gives 5,541 events"),
        ({"neg_thres": 0.005}, "sensor.neg_thres is 0.005, so"),
        ({"pos_thres": 0.009, "neg_thres": 0.009}, "sensor.pos_thres and neg_thres are 0.009"),
        ({"pos_thres": 20.0}, "sensor.pos_thres is 20, so one event takes e^20 times the light"),
        ({"neg_thres": 3.0}, "sensor.neg_thres is 3, so one event takes 20 times the light"),
        ({"sigma_thres": 0.2},
         "sensor.pos_thres and neg_thres are 0.2 with sigma_thres=0.2, so 17 % of"),
        ({"refractory_period_s": 100.0},
         "sensor.refractory_period_s is 100, so a pixel is blind for 100 s after each event"),
        ({"cutoff_hz": 0.01}, "sensor.cutoff_hz is 0.01, so a pixel lags 16 s behind the light"),
        ({"follower_hz": 0.1}, "sensor.follower_hz is 0.1, so a pixel lags 1.6 s behind the light"),
    ],
)  # fmt: skip
def test_one_line_names_the_key(given: dict[str, float], said: str) -> None:
    (line,) = of(**given)
    assert line.startswith("camera 'eye': ")
    assert said in line


@pytest.mark.parametrize(
    ("fovy", "said"),
    [
        (0.8, "view is 0.8 degrees; if 0.8 are radians, give fovy=45.8"),
        (3.0, "fovy=172"),
        (5.0, ""),
    ],
)
@pytest.mark.parametrize("own", [True, False])
def test_a_view_in_radians_is_doubted(fovy: float, said: str, own: bool) -> None:
    text = f"""<mujoco><worldbody><light/><camera name="eye" fovy="{45 if own else fovy}"/>
    <geom size="1" pos="0 0 -5"/></worldbody></mujoco>"""
    world = World(mujoco.MjModel.from_xml_string(text))
    camera = evs.CameraConfig(fovy=fovy) if own else "eye"
    world.add_camera(camera, sensor="ideal")
    (info,) = [one.info for one in world.cameras]
    lines = lint("eye", info.config, info.camera_info)
    assert [said in line for line in lines] == [True] * bool(said)


@pytest.mark.parametrize(("luminance", "lines"), [(0.5, 0), (15.0, 0), (200.0, 1), (math.inf, 0)])
def test_a_picture_on_another_scale_is_doubted(luminance: float, lines: int) -> None:
    found = lint("eye", {"sensor": {"exposure_dn": 255.0}}, None, luminance)
    assert len(found) == lines
    assert all("mean luminance of 200 (51,000 DN" in one for one in found)
    assert not lint("eye", {"sensor": {"exposure_dn": 0.51}}, None, luminance)


@pytest.mark.parametrize(
    ("unit", "scale", "said"),
    [
        ("auto", 255.0, "if it is 255, give unit='dn'"),
        ("luminance", 255.0, "if it is 255, give unit='dn'"),
        ("srgb", 255.0, "if it is 255, give unit='dn'"),
        ("dn", 1.0, "if it is 1.0, give unit='luminance'"),
        ("dn", 255.0, ""),
        ("luminance", 1.0, ""),
        ("luminance", 15.0, ""),
        ("lux", 1e5, ""),
    ],
)
def test_frames_on_another_scale_are_doubted_once(unit: str, scale: float, said: str) -> None:
    pixels = evs.Pixels("ideal", size=(8, 6), unit=unit)
    frame = np.random.default_rng(0).random((6, 8)) * scale
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for t_us in (1000, 2000, 3000):
            pixels.observe(frame, t_us)
    assert [said in str(one.message) for one in caught] == [True] * bool(said)


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
    report = run(World.from_config(config), sinks, 0.005, warn=said.append)
    assert said == ["camera 'camera': " + of(cutoff_hz=0.01)[0].removeprefix("camera 'eye': ")]
    assert report.warnings == said
