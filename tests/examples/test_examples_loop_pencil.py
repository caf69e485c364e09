"""The pencil stands, in process and over the wire, by what its controller may know and no more."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from apart import controlled_apart

from evs.drivers import files
from evs.drivers.bus.address import free_address
from evs.examples.pencil import TRACKERS
from evs.examples.pencil.balance import FRICTION, MASS_KG
from evs.examples.pencil.controller import CAMERAS, Controller, make_tracker
from evs.examples.pencil.environment import PencilExperiment, PencilLoop, PencilTrial, pencil_model
from evs.examples.pencil.line_tracker import PrincipalPoint
from evs.examples.pencil.stereo import DISTANCE_M, FOCAL_PX
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, Observation

pytestmark = pytest.mark.integration

FAR_S = 30.0


def test_it_stands_from_two_starts_though_it_is_pushed() -> None:
    experiment = PencilExperiment("events")
    for seed in (0, 1):
        outcome = experiment.play(PencilTrial(push_mns=3.0, seconds=3.0, seed=seed))
        assert not outcome.fallen
        # half of the way to the ends of the rails
        assert outcome.sway_mm < 50.0


def test_without_a_hand_it_falls() -> None:
    # what makes the others worth something: nothing else holds the stick
    loop = PencilLoop(max_s=3.0)
    observation = loop.reset(0)
    while not observation.done:
        observation = loop.step(np.zeros(2))
    assert "tilt" in observation.done
    assert observation.t_us < 1_000_000


@pytest.mark.parametrize("tracker", [name for name in TRACKERS if name != "events"])
def test_frames_hold_it_too(tracker: str) -> None:
    assert not PencilExperiment(tracker).play(PencilTrial(push_mns=1.0, seconds=1.5)).fallen


@pytest.mark.slow
@pytest.mark.campaign
def test_it_stands_for_half_a_minute() -> None:
    # from 20 starts: evs loop pencil --table
    experiment = PencilExperiment("events")
    trial = PencilTrial(push_mns=2.0, seconds=FAR_S, seed=2000)
    assert experiment.play(trial).stood_s == FAR_S


def test_a_trial_is_its_seed() -> None:
    first, again = PencilExperiment("events"), PencilExperiment("events")
    trial = PencilTrial(push_mns=3.0, seconds=0.7, seed=5)
    paths: list[list[bytes]] = [[], []]
    for experiment, path in zip((first, again), paths, strict=True):
        # what was played before leaves nothing behind
        experiment.play(PencilTrial(seconds=0.1, seed=1))
        experiment.play(
            trial,
            watch=lambda observation, _, path=path: path.append(observation.position.tobytes()),
        )
    assert paths[0] == paths[1]


def test_the_controllers_numbers_are_the_scenes() -> None:
    loop = PencilLoop()
    for camera in loop.world.cameras:
        fx, _, cx, _, fy, cy, *_ = camera.info.camera_info["k"]
        assert (fx, fy) == pytest.approx((FOCAL_PX, FOCAL_PX), rel=1e-6)
        assert (cx, cy) == pytest.approx((PrincipalPoint().x, PrincipalPoint().y), abs=1e-4)
    model = loop.world.model
    assert tuple(camera.name for camera in loop.world.cameras) == CAMERAS
    np.testing.assert_allclose(np.abs(model.cam_pos[:2]).max(1), DISTANCE_M)
    assert float(model.body_mass.sum()) == pytest.approx(MASS_KG)
    assert list(model.dof_damping[:2]) == [FRICTION, FRICTION]


@pytest.mark.parametrize("length_m", [0.2, 0.03])
def test_a_short_stick_is_cut_from_the_same_pencil(length_m: float) -> None:
    model = pencil_model(length_m)
    body = model.body("pencil").id
    assert float(model.body_mass[body]) == pytest.approx(0.1 * length_m)
    assert float(model.body_ipos[body][2]) == pytest.approx(length_m / 2)
    # a thin rod; the radius adds r^2 / 4
    inertia = 0.1 * length_m * (length_m**2 / 12 + 0.0035**2 / 4)
    assert sorted(model.body_inertia[body])[1] == pytest.approx(inertia, rel=1e-6)
    with pytest.raises(EvsError, match=r"0\.005 \.\.\. 0\.22"):
        pencil_model(0.3)


def test_without_events_it_falls() -> None:
    blind = PencilLoop()
    controller, observation = Controller(make_tracker(0, 0.2)), blind.reset(3)
    while not observation.done and observation.t_us < 2_000_000:
        less = Observation(observation.t_us, (), observation.position, observation.velocity)
        observation = blind.step(controller.decide(less))
    assert observation.done


def test_a_process_that_has_no_simulator_balances_it() -> None:
    loop = PencilLoop(push_mns=2.0, max_s=1.2)
    assert "1.2 s are over" in controlled_apart("pencil", loop)
    # and the same as in process, to the last bit
    here, observation = Controller(make_tracker(0, 0.2)), None
    again = PencilLoop(push_mns=2.0, max_s=1.2)
    observation = again.reset(3)
    while not observation.done:
        observation = again.step(here.decide(observation))
    np.testing.assert_array_equal(again.world.data.qpos, loop.world.data.qpos)


def test_the_launch_file_runs_world_controller_and_recorders(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["seconds:=1", "push:=3", "seed:=4", f"record:={tmp_path / 'run.aedat4'}"]
    assert main(["launch", "pencil", *words]) == 0
    assert "[controller] 1 s: 1 s are over" in capfd.readouterr().out
    # what the world recorded, in a process of its own, is what happens in process
    loop = PencilLoop(push_mns=3.0, max_s=1.0)
    packets: list[EventPacket] = []
    loop.on_tick = packets.extend
    controller, observation = Controller(make_tracker(0, 0.2)), loop.reset(4)
    while not observation.done:
        observation = loop.step(controller.decide(observation))
    for camera in CAMERAS:
        file = tmp_path / f"run-{camera}.aedat4"
        told = json.loads(Path(f"{file}.report.json").read_text())
        assert told["packets"] == 2000
        sent = np.concatenate([packet.events for packet in packets if packet.camera == camera])
        np.testing.assert_array_equal(files.read(file), sent)


def test_the_launch_file_tells_that_it_fell(capfd: pytest.CaptureFixture[str]) -> None:
    # pushed over; exit code 1 is the controller's
    assert main(["launch", "pencil", "push:=300", "seconds:=3"]) == 1
    assert "[controller] 0." in (said := capfd.readouterr().out)
    assert "left -0.7 ... 0.7" in said


def test_the_world_in_real_time(tmp_path: Path) -> None:
    """The same controller; the clock moves the stick, and the report says how late it was."""
    address, report = free_address(), tmp_path / "report.json"
    command = [sys.executable, "-m", "evs.launch.main", "loop", "pencil", "--serve", address]
    command += ["--seconds", "1", "pace=realtime", "realtime.serve=true", f"report={report}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as world:
        assert main(["loop", "pencil", "--connect", address]) in (0, 1)
        world.send_signal(signal.SIGINT)
        out, _ = world.communicate(timeout=60)
    assert world.returncode == 0
    assert "next:" not in out
    told = json.loads(report.read_text())
    assert told["config"] == {
        "loop": "pencil",
        "tracker": "events",
        "seconds": 1.0,
        "push": 2.0,
        "delay": 0.0,
        "length": 0.2,
        "keys": {"pace": "realtime", "realtime.serve": "true", "report": str(report)},
    }
    assert told["pace"]["late_ms"]["worst"] >= 0
    assert {"world", "render", "sensor"} <= set(told["stage_ms"])


def test_the_command_measures_films_and_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["loop", "pencil", "--seconds", "0.3"]) == 0
    assert "stood for 0.3 s" in capsys.readouterr().out
    picture = tmp_path / "pencil.gif"
    assert main(["loop", "pencil", "--gif", str(picture), "--seconds", "0.2", "--quiet"]) == 0
    assert picture.read_bytes()[:4] == b"GIF8"
    for words, said in (
        (["loop", "cup"], "no loop 'cup'"),
        (["loop", "pencil", "--tracker", "50 FPS"], "no tracker '50 FPS'"),
        (["loop", "pencil", "--table", str(tmp_path / "a.txt")], "end it in .json"),
        (["loop", "pencil", "--gif", str(tmp_path / "a.png")], "end it in .gif"),
        (["loop", "pencil", "--length", "1"], "0.005 ... 0.22"),
        (["loop", "pencil", "--delay", "inf"], "a finite number"),
        (["loop", "pencil", "--push", "nan"], "a finite number"),
        (["loop", "pencil", "--speed", "5"], "--speed is for goalie, not for the pencil"),
        (
            ["loop", "goalie", "--push", "5"],
            "--push is for pencil and cartpole, not for the goalie",
        ),
        (["loop", "pencil", "--quick"], "--quick is for --table"),
        (["loop", "pencil", "record=run.aedat4"], "for --serve"),
        (["loop", "pencil", "--key", "a.key"], "for --connect"),
        (["loop", "pencil", "--serve", "tcp://127.0.0.1:0", "scene.file=a.xml"], "scene.file is"),
        (["loop", "pencil", "--serve", "tcp://127.0.0.1:0", "lockstep.cameras=a"], "is not for"),
        (["loop", "pencil", "--serve", "tcp://127.0.0.1:0", "pace=free"], "at lockstep"),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.campaign
def test_a_rehearsal_of_the_table(tmp_path: Path) -> None:
    file = tmp_path / "table.json"
    assert main(["loop", "pencil", "--table", str(file), "--quick", "--quiet"]) == 0
    told = json.loads(file.read_text())["rows"]
    assert list(told) == list(TRACKERS)
    for row in told.values():
        assert set(row) == {"gains", "shortest_m", "strongest_mns", "longest_ms", "stood"}
        assert row["stood"]["stood"] == row["stood"]["starts"] >= 1
    page = file.with_suffix(".md").read_text()
    assert all(f"| {tracker} |" in page for tracker in TRACKERS)
    before = file.read_bytes()
    # nothing is left to do
    assert main(["loop", "pencil", "--table", str(file), "--quick", "--quiet"]) == 0
    assert file.read_bytes() == before
