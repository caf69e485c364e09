"""LoopRunner: what it runs, what it keeps of failures and runs again, what it refuses."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.msgs import EvsError, Observation
from evs.tools.testing import LoopRunner, Push, Run, replay
from evs.tools.testing.evidence import options_of, plain_options

CART = "evs:config/scenes/cartpole.xml"
OPTIONS: dict[str, Any] = {
    "cameras": "onboard",
    "sensor": evs.SensorConfig(preset="dvs128", width=32, height=24),
    "threads": 1,
}


class Swing:
    """Pushes the cart to and fro, and remembers what it was given."""

    made: list[Swing]

    def __init__(self) -> None:
        self.seen: list[Observation] = []
        type(self).made.append(self)

    def __call__(self, seen: Observation) -> Any:
        self.seen.append(seen)
        # None now and then: the last control stays
        return None if len(self.seen) % 5 == 0 else [0.3 * np.sin(len(self.seen) / 4)]


@pytest.fixture
def runner(tmp_path: Path) -> LoopRunner:
    Swing.made = []
    return LoopRunner(tmp_path / "kept")


def swing(runner: LoopRunner, **options: Any) -> Run:
    return runner(CART, Swing, **{"seconds": 0.2, **OPTIONS, **options})


def files_of(error: AssertionError) -> list[Path]:
    """Every path in a message."""
    return [Path(found) for found in re.findall(r"/\S+?\.(?:npz|aedat4)\b", str(error))]


def test_each_seed_has_a_controller_and_an_episode_of_its_own(runner: LoopRunner) -> None:
    run = swing(runner, seeds=[4, 7], start={"hinge": (-0.1, 0.1)}, ticks=2)
    assert [trace.seed for trace in run.traces] == [4, 7]
    assert len(Swing.made) == 2
    for trace, controller in zip(run.traces, Swing.made, strict=True):
        assert trace.t_us.tolist() == list(range(0, 200_001, 2000))
        assert [seen.t_us for seen in controller.seen] == trace.t_us[:-1].tolist()
        assert (trace.ctrl.shape, trace.compute_s.shape) == ((100, 1), (100,))
        assert np.isnan(trace.ctrl[4, 0])
        assert trace.ctrl[0, 0] == pytest.approx(0.3 * np.sin(0.25))
        assert (trace.compute_s > 0).all()
        assert set(trace.sensors) == {"angle", "position"}
        assert trace.events > 0
    first, second = (trace.value("angle") for trace in run.traces)
    assert first[0] != second[0]
    assert abs(first[0]) <= 0.1
    run.never_ends()


def test_the_same_seed_is_the_same_episode(runner: LoopRunner) -> None:
    once, again = (swing(runner, seeds=[3], start={"hinge": (-0.1, 0.1)}) for _ in range(2))
    for name, values in once.traces[0].sensors.items():
        assert np.array_equal(values, again.traces[0].sensors[name])
    first, second = Swing.made
    assert first.seen == second.seen


def test_a_controller_gets_observations_and_nothing_else(runner: LoopRunner) -> None:
    swing(runner)
    (controller,) = Swing.made
    assert {type(seen) for seen in controller.seen} == {Observation}
    assert all(seen.state is None for seen in controller.seen)
    assert sum(len(packet) for seen in controller.seen for packet in seen.packets) > 0


def test_sensors_are_those_of_the_moment(runner: LoopRunner) -> None:
    run = swing(runner, sensors=["angle"], start={"hinge": (0.05, 0.05)})
    (trace,) = run.traces
    assert list(trace.sensors) == ["angle"]
    assert trace.value("angle")[0] == 0.05
    # the encoder has gear 20: the controller's own view of the same moments
    places = np.array([seen.position[0] for seen in Swing.made[0].seen]) / 20
    everything = swing(runner, start={"hinge": (0.05, 0.05)}).traces[0]
    assert everything.value("position")[:-1] == pytest.approx(places, abs=1e-12)


def test_a_push_acts_in_its_ticks_and_no_other(runner: LoopRunner) -> None:
    model = mujoco.MjModel.from_xml_path(
        str(Path(evs.__file__).parent / "config/scenes/cartpole.xml")
    )
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    body = model.body("pole").id
    angles = [0.0]
    for tick in range(100):
        data.xfrc_applied[body] = [2, 0, 0, 0, 0, 0] if 20 <= tick < 35 else 0
        mujoco.mj_step(model, data)
        angles.append(float(data.qpos[1]))
    push = Push("pole", at_s=0.02, force_n=(2.0, 0.0, 0.0), for_s=0.015)
    for ticks in (1, 10):
        still = runner(
            CART, lambda: lambda _seen: [0.0], pushes=[push], seconds=0.1, ticks=ticks, **OPTIONS
        )
        assert still.traces[0].value("angle") == pytest.approx(angles[::ticks], abs=1e-12)
    assert angles[20] == 0 != angles[21]


def test_what_fails_is_left_behind_and_runs_again_to_the_byte(runner: LoopRunner) -> None:
    delays = evs.DelayConfig(transport_us=3000, control_us=2000, drop_share=0.1)
    options: dict[str, Any] = {
        "seeds": [5, 6],
        "start": {"hinge": (0.02, 0.1)},
        "delays": delays,
        "pushes": [Push("pole", 0.05, (1.0, 0.0, 0.0)), Push("cart", 0.1, (0, 0, 0), (0, 0, 1.0))],
    }
    run = swing(runner, **options)
    worst = max(run.traces, key=lambda trace: float(np.abs(trace.value("angle")).max()))
    with pytest.raises(AssertionError, match="angle leaves its range") as caught:
        run.never_leaves("angle", -0.001, 0.001)
    evidence, recording = files_of(caught.value)[:2]
    assert evidence.name == f"seed-{worst.seed}.npz"
    assert recording.name == f"seed-{worst.seed}-onboard.aedat4"
    # what the controller saw, once more: without a loop, and with one of our own
    saw = Swing.made[[5, 6].index(worst.seed)].seen
    loop = evs.ClosedLoop(
        Path(evs.__file__).parent / "config/scenes/cartpole.xml", delays=delays, **OPTIONS
    )
    for seen in (list(replay(evidence)), list(replay(evidence, loop))):
        assert len(seen) == 201
        assert seen[1:-1] == saw[1:]
        assert np.array_equal(seen[0].position, saw[0].position)
    # and what the camera made, before any delay or loss
    assert len(evs.read(recording)) == worst.events
    with np.load(evidence) as kept:
        assert np.array_equal(kept["sensor/angle"], worst.sensors["angle"])


def test_every_run_of_a_test_keeps_its_own_files(runner: LoopRunner) -> None:
    kept = []
    for run in (swing(runner), swing(runner)):
        with pytest.raises(AssertionError) as caught:
            run.never_leaves("position", 1, 2)
        kept.append(files_of(caught.value)[0])
    assert len(set(kept)) == 2
    assert all(path.exists() for path in kept)


def test_a_controller_that_breaks_down_is_told_and_left_behind(runner: LoopRunner) -> None:
    def breaks(seen: Observation) -> Any:
        if seen.t_us == 30_000:
            raise ZeroDivisionError("in the controller")
        return [0.5]

    with pytest.raises(ZeroDivisionError) as caught:
        runner(CART, lambda: breaks, seconds=0.2, **OPTIONS)
    (note,) = caught.value.__notes__
    assert "seed 0, t = 0.030 s" in note
    assert len(list(replay(re.findall(r"/\S+?\.npz", note)[0]))) == 31
    # wrong controls too: the loop refuses them
    with pytest.raises(EvsError, match=r"shape \(2,\)"):
        runner(CART, lambda: lambda _seen: [1.0, 2.0], seconds=0.2, **OPTIONS)


def test_a_scene_without_actuators_is_looked_at(runner: LoopRunner) -> None:
    spec = mujoco.MjSpec.from_file(str(Path(evs.__file__).parent / "config/scenes/cartpole.xml"))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    run = runner(spec, lambda: lambda _seen: None, seconds=0.02, **OPTIONS)
    assert run.traces[0].ctrl.shape == (20, 0)
    with pytest.raises(AssertionError) as caught:
        run.never_leaves("angle", 1, 2)
    (evidence, _) = files_of(caught.value)[:2]
    assert len(list(replay(evidence, evs.ClosedLoop(spec, **OPTIONS)))) == 21


def test_an_episode_that_ends_is_not_gone_on_with(runner: LoopRunner) -> None:
    run = swing(runner, limits={"angle": (-0.05, 0.05)}, start={"hinge": (0.04, 0.04)}, seconds=1.0)
    (trace,) = run.traces
    assert trace.done == "angle left -0.05 ... 0.05"
    assert trace.t_us[-1] < 1_000_000
    assert len(trace.ctrl) == len(trace.t_us) - 1
    with pytest.raises(AssertionError, match="angle left"):
        run.never_ends()


def test_a_loop_of_ones_own_is_taken(runner: LoopRunner, tmp_path: Path) -> None:
    world = evs.World(Path(evs.__file__).parent / "config/scenes/cartpole.xml")
    world.add_camera("onboard", sensor=OPTIONS["sensor"])
    loop = evs.ClosedLoop.around(world)
    run = runner(loop, Swing, seconds=0.05)
    assert run.traces[0].events == sum(camera.events for camera in world.cameras)
    with pytest.raises(AssertionError) as caught:
        run.never_leaves("position", 1, 2)
    assert "loop=..." in str(caught.value)
    (evidence, _) = files_of(caught.value)[:2]
    with pytest.raises(EvsError, match="does not say how its loop was made"):
        list(replay(evidence))
    assert len(list(replay(evidence, loop))) == 51


def test_a_recorder_beside_ones_own_loop_stays(runner: LoopRunner) -> None:
    loop = evs.ClosedLoop(Path(evs.__file__).parent / "config/scenes/cartpole.xml", **OPTIONS)
    ticks: list[int] = []

    def beside(packets: tuple[evs.EventPacket, ...]) -> None:
        ticks.append(packets[0].time_end_us)

    loop.on_tick = beside
    run = runner(loop, Swing, seconds=0.02, pushes=[Push("pole", 0.005, (1.0, 0.0, 0.0))])
    assert ticks == list(range(1000, 20_001, 1000))
    with pytest.raises(AssertionError):
        run.never_leaves("position", 1, 2)
    # the episode was run again for its recording
    assert len(ticks) == 40
    assert loop.on_tick is beside
    assert not loop.world.data.xfrc_applied.any()


def test_options_survive_as_json() -> None:
    options = {
        "cameras": ("left", evs.CameraConfig(body="hand", pos=(0, 0, 0.1))),
        "sensor": evs.SensorConfig(readout=evs.ReadoutConfig(order="arbiter"), width=3),
        "limits": {"angle": (-0.5, 0.5)},
        "max_s": 3.0,
        "model": None,
    }
    plain = plain_options(options)
    assert plain is not None
    assert options_of(plain) == options
    assert plain_options({"scene": object()}) is None


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seconds": 0.0}, "that is not one decision"),
        ({"ticks": 0}, "that is not one decision"),
        ({"seeds": []}, "seeds is empty"),
        ({"seeds": ["one"]}, "seeds is 'one'"),
        ({"pushes": [(1, 2)]}, r"pushes holds \(1, 2\)"),
        ({"pushes": [Push("pol", 0.1)]}, "no body 'pol'; there is: pole"),
        ({"pushes": [Push("pole", float("nan"))]}, "not finite"),
        ({"sensors": ["angel"]}, "no sensor 'angel'; there is: angle"),
        ({"start": {"hing": (0, 1)}}, "no joint 'hing'"),
        ({"limit": {}}, "unexpected keyword argument 'limit'"),
        ({"cameras": "front"}, "no camera 'front'"),
    ],
)
def test_what_cannot_be_is_one_line(runner: LoopRunner, options: dict[str, Any], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        swing(runner, **options)


def test_something_that_makes_no_controller_is_refused(runner: LoopRunner) -> None:
    for wrong, says in (
        (3, "has to be something that makes"),
        (lambda: 3, "has to be something that makes"),
        (lambda seen: [0.0], "cannot be made"),
    ):
        with pytest.raises(EvsError, match=says):
            runner(CART, wrong, seconds=0.1, **OPTIONS)
    with pytest.raises(EvsError, match="cameras= belongs to the ClosedLoop"):
        runner(
            evs.ClosedLoop(Path(evs.__file__).parent / "config/scenes/cartpole.xml"),
            Swing,
            cameras="x",
        )


def test_a_file_that_is_no_evidence_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="no file"):
        list(replay(tmp_path / "none.npz"))
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "other.npz", ctrl=np.zeros(3))
    (tmp_path / "empty.npz").touch()
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name in ("text.npz", "other.npz", "empty.npz", "array.npy"):
        with pytest.raises(EvsError, match="is no evs closed loop 1 file"):
            list(replay(tmp_path / name))
