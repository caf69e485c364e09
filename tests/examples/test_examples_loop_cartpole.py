"""A stock cart-pole stands, by what a camera on its cart sees and its encoder says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from apart import controlled_apart

import evs
from evs.examples.cartpole.controller import CartPoleController, CartPoleGains, Plant, feedback
from evs.examples.cartpole.environment import CartPoleLoop, CartPoleTrial, play
from evs.examples.cartpole.tracker import CameraMount, PoleShape, PoleTracker
from evs.launch.main import main
from evs.msgs import Observation, join_events, make_events
from evs.tools.testing import LoopRunner

pytestmark = pytest.mark.integration


def test_it_stands_though_it_is_pushed(tmp_path: Path) -> None:
    # as a robotics team would say it: the fixture's runner on a loop of one's own
    run = LoopRunner(tmp_path)(
        CartPoleLoop(push_ns=3.0), lambda: CartPoleController().decide, seconds=2.5, seeds=[0, 1]
    )
    run.never_ends()
    run.never_leaves("place", -0.8, 0.8)
    # 3 N s on the middle of a pole of 5 kg set it off with 1.4 rad/s
    run.settles("angle", within=0.35, after_s=0.5)
    assert all(len(trace.ctrl) == 2500 for trace in run.traces)
    # from the starts that the loop draws
    assert len({trace.value("angle")[0] for trace in run.traces}) == 2


# the first two pushes, and all five of the program
@pytest.mark.slow
@pytest.mark.parametrize("seconds", [4.0, pytest.param(10.0, marks=pytest.mark.campaign)])
def test_it_stands_from_other_starts(seconds: float) -> None:
    # from 20 starts: evs loop cartpole --seeds 20
    loop = CartPoleLoop()
    trials = [CartPoleTrial(seed, push_ns=3.0, seconds=seconds) for seed in range(3)]
    outcomes = [play(loop, trial) for trial in trials]
    assert [outcome.ended for outcome in outcomes] == [""] * 3


def test_without_a_hand_or_without_events_it_falls() -> None:
    loop = CartPoleLoop(max_s=5.0)
    observation = loop.reset(0)
    while not observation.done:
        observation = loop.step([0.0])
    assert "angle left" in observation.done
    # the encoder alone does not tell where the pole is
    controller, observation = CartPoleController(), loop.reset(0)
    while not observation.done:
        blind = Observation(observation.t_us, (), observation.position, observation.velocity)
        observation = loop.step(controller.decide(blind))
    assert "left" in observation.done


def test_what_it_believes_is_where_the_pole_is() -> None:
    loop, controller = CartPoleLoop(push_ns=2.0), CartPoleController()
    observation, errors = loop.reset(2), []
    for _ in range(2000):
        observation = loop.step(controller.decide(observation))
        errors.append(controller.angle - loop.world.data.joint("hinge").qpos[0])
    # a pixel is 0.006 m wide at 1.1 m: 0.012 rad at the pole's tip, seen from its hinge
    assert np.sqrt(np.mean(np.square(errors[300:]))) < 0.015


def test_the_tracker_follows_edges_and_nothing_else() -> None:
    mount, pole = CameraMount(), PoleShape()
    m_per_px = 2 * mount.distance_m * np.tan(np.radians(mount.fovy_deg) / 2) / mount.height

    def edges(angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Pixels of both edges of a pole at an angle, by plain geometry."""
        along = np.linspace(0.3, 0.5, 40)
        across = np.array([[pole.half_width_m], [-pole.half_width_m]])
        right = along * np.sin(angle) + across * np.cos(angle)
        up = along * np.cos(angle) - across * np.sin(angle) - mount.height_m
        x = np.floor(mount.width / 2 + right / m_per_px)
        y = np.floor(mount.height / 2 - up / m_per_px)
        return x.ravel(), y.ravel()

    for angle in (-0.3, -0.05, 0.0, 0.2):
        tracker = PoleTracker(inset_px=0.0)
        tracker.angle = angle + 0.05
        for _ in range(5):
            x, y = edges(angle)
            t = np.arange(len(x))
            tracker.update(make_events(t, x, y, np.ones(len(x))))
        assert tracker.angle == pytest.approx(angle, abs=0.01)
        # what grows darker, and what is far away, moves nothing
        before = tracker.angle
        tracker.update(make_events(t, x, y, np.zeros(len(x))))
        tracker.update(make_events([1], [3], [60], [1]))
        assert tracker.angle == before


def test_the_gains_place_the_poles() -> None:
    square, gains = 1.5 * 9.81 / 0.6, CartPoleGains()
    g = 9.81
    plant = np.array([[0, 1, 0, 0], [square, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0.0]])
    drive = np.array([[0], [-square / g], [0], [1.0]])
    poles = np.linalg.eigvals(plant + drive @ feedback(square, gains)[np.newaxis])
    w = np.sqrt(square)
    wanted = [-gains.fast * w, -gains.fast * w, -gains.slow * w, -gains.slow * w]
    # double poles move with the root of what is rounded
    assert np.sort(poles.real) == pytest.approx(wanted, rel=1e-4)


def test_the_controllers_numbers_are_the_robots() -> None:
    loop = CartPoleLoop()
    model = loop.world.model
    assert float(model.body_mass.sum()) == pytest.approx(Plant().mass_kg, rel=0.01)
    assert float(model.actuator_gear[0, 0]) == Plant().gear
    assert list(model.actuator_ctrlrange[0]) == [-Plant().control, Plant().control]
    assert float(model.geom("cpole").size[0]) == PoleShape().half_width_m
    (stream,) = loop.streams
    assert (stream.width, stream.height) == (CameraMount().width, CameraMount().height)
    focal_px = 0.5 * CameraMount().height / np.tan(np.radians(CameraMount().fovy_deg) / 2)
    assert stream.camera_info["k"][0] == pytest.approx(focal_px, rel=1e-6)


def test_a_process_that_has_no_simulator_balances_it() -> None:
    loop = CartPoleLoop(push_ns=3.0, max_s=1.2)
    assert "1.2 s are over" in controlled_apart("cartpole", loop)
    # and the same as in process, to the last bit
    controller, again = CartPoleController(), CartPoleLoop(push_ns=3.0, max_s=1.2)
    observation = again.reset(3)
    while not observation.done:
        observation = again.step(controller.decide(observation))
    np.testing.assert_array_equal(again.world.data.qpos, loop.world.data.qpos)


def test_the_launch_file_runs_world_controller_and_recorder(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "run.aedat4"
    assert main(["launch", "cartpole", "seconds:=0.5", "seed:=4", f"record:={record}"]) == 0
    assert "[controller] 0.5 s: 0.5 s are over" in capfd.readouterr().out
    # what was recorded is what the loop makes in process
    controller, loop = CartPoleController(), CartPoleLoop(push_ns=3.0, max_s=0.5)
    observation, parts = loop.reset(4), []
    while not observation.done:
        observation = loop.step(controller.decide(observation))
        parts += [packet.events for packet in observation.packets]
    np.testing.assert_array_equal(evs.read(record), join_events(parts))


def test_the_command_plays_films_and_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["loop", "cartpole", "--seconds", "0.3", "--seeds", "2"]) == 0
    assert "2 of 2 stood for 0.3 s" in capsys.readouterr().out
    # nobody stands that
    assert main(["loop", "cartpole", "--seconds", "2", "--push", "20000"]) == 1
    assert "left" in capsys.readouterr().out
    picture = tmp_path / "cartpole.gif"
    assert main(["loop", "cartpole", "--gif", str(picture), "--seconds", "0.2", "--quiet"]) == 0
    assert picture.read_bytes()[:4] == b"GIF8"
    for words, said in (
        (["--table", str(tmp_path / "a.json")], "has no --table"),
        (["--tracker", "60 FPS"], "no tracker '60 FPS'"),
        (["--seeds", "0"], "--seeds is 0"),
        (["--seconds", "0"], "--seconds is 0"),
    ):
        assert main(["loop", "cartpole", *words]) == 2
        assert said in capsys.readouterr().err
