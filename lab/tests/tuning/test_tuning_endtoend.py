"""`evs tune` measures a tiny scene for real, and what it wrote runs as is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from evs.drivers.run.config import PIPELINES, load
from evs.launch.main import main
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.sweep.errors import ErrorSettings
from evs_lab.sweep.pareto_front import DEFAULT
from evs_lab.sweep.speed import SpeedSettings
from evs_lab.tuning.base_pipeline import base_pipeline
from evs_lab.tuning.measurement import MeasurementEffort, open_measurer
from evs_lab.tuning.search import Search, TuningGoal
from evs_lab.tuning.space import Candidate, candidates

pytestmark = pytest.mark.integration

SCENE = PIPELINES.parent / "scenes" / "pendulum.xml"
SMALL = [("sensor.width", "48"), ("sensor.height", "36"), ("scene.tick_us", "1000")]
WASHED_OUT = """<mujoco>
  <visual><headlight ambient="2 2 2" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <light type="directional" dir="1 0.3 -1" diffuse="0.6 0.6 0.6"/>
    <camera name="front" pos="0 -2 0.4" xyaxes="1 0 0 0 0.2 1"/>
    <geom type="plane" size="2 2 .1" rgba=".5 .5 .5 1"/>
    <body pos="0 0 0.4">
      <joint type="hinge" axis="0 0 1"/>
      <geom type="box" size="0.35 0.3 0.25"/>
    </body>
  </worldbody>
  <keyframe><key qpos="0" qvel="12"/></keyframe>
</mujoco>"""
"""A box that turns in a lamp's light, which its headlight drowns."""

LITTLE = MeasurementEffort(
    ErrorSettings(pixels=128, ticks=60, reference_spp=64), SpeedSettings(seconds=0.1, repeats=2)
)


@pytest.mark.slow
def test_a_tiny_scene_is_tuned_and_the_file_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(SCENE.read_text())
    words = [f"{key}={text}" for key, text in SMALL] + ["--cache", "cache", "--quick"]
    # a tenth of a 346 x 260 picture's fiftieth is reached everywhere
    assert main(["tune", "robot.xml", "--rtf", "0.05", *words, "--budget", "60"]) == 0
    told = dict(
        line.split(None, 1) for line in capsys.readouterr().out.splitlines() if " " in line.strip()
    )
    assert told["goal"] == "real-time factor of at least 0.05; reached"
    config = load("tuned.toml")
    assert (config.sensor.width, config.sensor.height, config.scene.tick_us) == (48, 36, 1000)
    # what is so slow a goal is best met by many samples
    assert config.render.samples > 1
    assert float(told["error"].split()[0]) < 0.3
    run = ["emulate", "tuned.toml", "--duration", "0.02", "--record", "run.npz", "--quiet"]
    assert main(run) == 0
    assert Path("run.npz").exists()
    # nothing keeps up with this
    assert main(["tune", "robot.xml", "--rtf", "1e6", *words, "render.renderer=direct", "-o",
                 "x.toml"]) == 1  # fmt: skip
    assert not Path("x.toml").exists()


@pytest.mark.slow
def test_what_is_measured_is_of_the_pipeline_that_is_asked_for(tmp_path: Path) -> None:
    """Light that a pipeline takes away is not in the reference either."""
    (tmp_path / "box.xml").write_text(WASHED_OUT)
    keys = [*SMALL, ("render.headlight", "off"), ("scene.keyframe", "0")]
    base = base_pipeline(str(tmp_path / "box.xml"), keys)
    few = Candidate("path", 1, "fixed", "fixed", "plain")
    many = Candidate("path", 64, "fixed", "fixed", "plain")
    with open_measurer(base, "still", DEFAULT, LightCache(tmp_path / "cache"), LITTLE) as measurer:
        assert measurer.point(many).config.render.headlight == "off"
        assert measurer.error(many) < 0.1
        assert measurer.error(many) < measurer.error(few)
        assert 0.0 < measurer.reference_error < 0.1
        assert measurer.rtf(many) < measurer.rtf(few)
        assert 0.0 < measurer.speeds[few].rays_per_tick <= 48 * 36
        assert 0.0 < measurer.seconds(many, 0.5) < 60.0
        every = candidates({"model.name": "plain", "scene.tick_us": 1000, "threads": 1,
                           "render.renderer": "path"})  # fmt: skip
        goal = TuningGoal(error=2.0 * measurer.reference_error + 0.1)
        found = Search(every, goal, measurer, lambda: math.inf).run()
    assert found.reached
    assert found.verified
    assert found.winner.candidate.spp < 1024
