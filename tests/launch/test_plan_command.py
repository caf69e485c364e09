"""evs plan: what it prints, and that every report has the same plan."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from evs.emulator.base.features import NAMES
from evs.emulator.simulation.world import World
from evs.launch.main import main

SCENE = str(Path(__file__).parents[2] / "config/scenes/pendulum.xml")
SMALL = ["sensor.width=32", "sensor.height=24"]


def planned(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["plan", *words, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_plan_of_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    found = planned(capsys, SCENE, *SMALL)
    assert (found["camera"], found["sensor"], found["model"]) == ("front", "davis346", "plain")
    assert (found["sinks"], found["measured"]) == ([], None)
    plan = found["plan"]
    assert plan["contents"]["geoms"] == {"box": 1, "capsule": 1, "plane": 1, "sphere": 1}
    assert (plan["contents"]["geoms_moving"], plan["contents"]["bodies_moving"]) == (3, 2)
    assert "camera_moves" not in plan["contents"]
    # each code path stands once, with its reason where it is off; the network has its own
    assert sorted([*plan["on"], *plan["off"]]) == sorted({*NAMES} - {"cold_tiles"})
    assert {"shadows", "low_pass", "leak", "photon_noise", "readout"} <= {*plan["on"]}
    assert all(len(why) > 5 for why in plan["off"].values())
    assert plan["off"]["colour"] == "every light is grey: luminance is enough"
    assert plan["forced"] == []
    assert plan["view"]["camera_rays"] == 8 * 6 * 16 * 4
    assert plan["view"]["shadow_rays"] == 8 * 6 * 16 * 4 * plan["contents"]["casting"] > 0


def test_the_keys_of_emulate_change_it(capsys: pytest.CaptureFixture[str]) -> None:
    words = [SCENE, *SMALL, "--renderer", "path", "--model", "evsnet", "--publish", "ipc:///x"]
    found = planned(capsys, *words, "model.chunk=8", "sensor.imu.enabled=true")
    assert (found["renderer"], found["model"], found["sinks"]) == ("path", "evsnet", ["zmq"])
    assert {"colour", "physical_gloss", "imu"} <= {*found["plan"]["on"]}
    assert found["plan"]["off"]["cold_tiles"] == "tiles in which nothing moves are skipped"
    assert "leak" not in [*found["plan"]["on"], *found["plan"]["off"]]


def test_groups_that_are_seen_and_geoms_that_are_not(capsys: pytest.CaptureFixture[str]) -> None:
    usual = planned(capsys, SCENE, *SMALL)["plan"]["contents"]
    assert usual["seen"].startswith("geomgroup 0 1 2, sitegroup 0 1 2")
    assert "hidden_geoms" not in usual
    words = ["scene.visual.geomgroup=[1]", "scene.visual.static=false"]
    with pytest.raises(SystemExit) as stopped:
        raise SystemExit(main(["plan", SCENE, *SMALL, *words]))
    assert stopped.value.code == 2
    assert "4 in group 0" in capsys.readouterr().err
    words = ["scene.visual.static=false", "scene.visual.texture=false"]
    still = planned(capsys, SCENE, *SMALL, *words)["plan"]["contents"]
    assert still["seen"].endswith("flexgroup 0 1 2, texture off, static off")
    assert still["hidden_geoms"] == ["1 in group 0 (floor)"]
    assert main(["plan", SCENE, *SMALL, *words]) == 0
    shown = capsys.readouterr().out
    assert "hidden geoms" in shown
    assert "1 in group 0 (floor)" in shown


def test_everything_is_said_to_be_forced(capsys: pytest.CaptureFixture[str]) -> None:
    plan = planned(capsys, "--scene", SCENE, *SMALL, "--model-everything")["plan"]
    assert {"fog", "haze", "aps", "imu", "causes", "ground_truth"} <= {*plan["forced"]}
    assert {*plan["forced"]} <= {*plan["on"]}
    assert {*plan["off"]} == {"lens", "running_mean", "glowing", "transparent", "cached_light"}


def test_a_pipeline_and_what_it_takes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'[scene]\nfile = "{SCENE}"\n[sensor]\nwidth = 32\nheight = 24\n')
    measured = planned(capsys, str(file), "--measure", "7")["measured"]
    assert measured["ticks"] == 7
    assert {*measured["stage_ms"]} == {"world", "render", "sensor"}
    assert all(ms > 0 for ms in measured["stage_ms"].values())
    assert 0 < measured["traced_fraction"] < 1


def test_the_tables(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", SCENE, *SMALL, "--measure", "3"]) == 0
    out = capsys.readouterr().out
    for line in (
        "geoms          1 box, 1 capsule, 1 plane, 1 sphere",
        "camera         stands still",
        "code paths that are on\ncode path         because",
        f"{'fog':17s}  render.fog=false",  # beside "refractory spread"
        "3,072 from the camera, at most 3,072 to lights",
        "measured: 3 ticks, threads: one a core",
    ):
        assert line in out
    # what is on comes first
    assert out.index("shadows  ") < out.index("code paths that are off") < out.index("fog  ")


def test_opengl_casts_no_rays_and_nothing_is_guessed(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyrender")
    assert main(["plan", SCENE, *SMALL, "--renderer", "raster"]) == 0
    out = capsys.readouterr().out
    assert "rays" not in out
    assert out.endswith("\ntime of a tick: add --measure, which runs 100 ticks\n")


def test_ctrl_c_ends_the_measuring_and_what_was_measured_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    step = World.step

    def interrupted(world: World) -> Any:
        if world.tick == 4:
            signal.raise_signal(signal.SIGINT)
        return step(world)

    monkeypatch.setattr(World, "step", interrupted)
    assert main(["plan", SCENE, *SMALL, "--measure", "1000"]) == 130
    assert "measured: 5 ticks" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "no scene"),
        (["a.xml", "b.xml"], "two scenes"),
        ([SCENE, "--measure", "0"], "give a number of ticks"),
        ([SCENE, "plan.on=fogg"], "no code path 'fogg'"),
        ([SCENE, "plan.on=lens"], "'lens' cannot be on where nothing needs it"),
    ],
)
def test_what_cannot_be_is_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", *words]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1


def test_every_report_has_the_plan(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    recording, report = tmp_path / "a.npz", tmp_path / "a.json"
    words = ["--scene", SCENE, "--duration", "0.002", *SMALL, "--quiet"]
    assert main(["emulate", *words, "--record", str(recording), "--report", str(report)]) == 0
    expected = planned(capsys, SCENE, *SMALL)["plan"]
    for file in (report, tmp_path / "a.npz.report.json"):
        (camera,) = json.loads(file.read_text())["cameras"]
        assert camera["plan"] == expected


def test_reflectance_that_mirrors_nothing_is_said(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text("""<mujoco><asset><material name="m" reflectance=".5"/></asset><worldbody>
        <geom size=".1" material="m"/><geom type="box" size=".1 .1 .1" material="m"/>
        <geom type="plane" size="1 1 .1"/></worldbody></mujoco>""")
    contents = planned(capsys, str(scene), *SMALL)["plan"]["contents"]
    assert (contents["mirrors"], contents["not_mirrors"]) == (1, 1)
    assert main(["plan", str(scene), *SMALL]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = [line for line in lines if line.startswith("not mirrors ")]
    assert "shapes that do not mirror" in line
