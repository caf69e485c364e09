"""The Gymnasium environments: what gymnasium's own checker says, spaces, ends, rewards, errors."""

from __future__ import annotations

import copy
import subprocess
import sys
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import evs
from evs.drivers.gym import ENVIRONMENTS, LoopEnv
from evs.emulator.representations import event_frame, padded_packet, time_surface, voxel_grid
from evs.emulator.simulation.stacked_arrays import KINDS
from evs.msgs import EvsError, join_events
from reference.episodes import same

CART = "evs:config/scenes/cartpole.xml"
SMALL: dict[str, Any] = {"size": (24, 20), "max_s": 0.4}
ARGUMENTS: dict[str, dict[str, Any]] = {
    "evs/Loop-v0": {"scene": CART, "cameras": ("onboard", "watch"), "limits": {"angle": (-1, 1)}}
}


def make(name: str = "evs/CartPole-v0", **options: Any) -> Any:
    return gymnasium.make(name, **{**SMALL, **ARGUMENTS.get(name, {}), **options}).unwrapped


def rollout(env: Any, seed: int, steps: int = 25) -> list[Any]:
    """Everything that an episode says under seeded actions."""
    env.action_space.seed(seed)
    told = [env.reset(seed=seed)]
    for _ in range(steps):
        told.append(env.step(env.action_space.sample()))
        if told[-1][2] or told[-1][3]:
            break
    return told


@pytest.mark.parametrize(("name", "kind"), list(product(ENVIRONMENTS, KINDS)))
@pytest.mark.parametrize("encoders", [False, True])
def test_gymnasiums_checker_has_nothing_to_say(name: str, kind: str, encoders: bool) -> None:
    # a warning of the checker is an error here, as every warning is
    # pictures, which start a process, depend on neither
    pictures = kind == KINDS[0] and not encoders
    check_env(make(name, observation=kind, encoders=encoders), skip_render_check=not pictures)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_episode(kind: str) -> None:
    options: dict[str, Any] = {"observation": kind, "sensor": "dvs128", "encoders": True}
    env = make("evs/Reach-v0", **options)
    first = rollout(env, 5)
    assert same(first, rollout(env, 5))
    assert same(first, rollout(make("evs/Reach-v0", **options), 5))
    assert not same(first, rollout(env, 6))
    assert sum(told[-1]["events"] for told in first) > 50


@pytest.mark.parametrize("kind", KINDS)
def test_a_deep_copy_goes_on_with_the_same_bytes_and_alone(kind: str) -> None:
    options: dict[str, Any] = {
        "observation": kind,
        "encoders": True,
        "sensor": "dvs128",
        "randomise": {"pos_thres": "uniform(0.1, 0.3)"},
    }
    env = make("evs/Reach-v0", **options)
    rollout(env, 5, 7)
    twin, later = copy.deepcopy(env), copy.deepcopy(env)
    actions = [env.action_space.sample() for _ in range(4)]
    first = [env.step(action) for action in actions]
    assert sum(told[-1]["events"] for told in first) > 0
    assert same(first, [twin.step(action) for action in actions])
    assert same(env.reset(), twin.reset())
    # nothing that the others did since has reached it
    assert same(first, [later.step(action) for action in actions])
    # before the first reset, too
    assert same(rollout(copy.deepcopy(make("evs/Reach-v0", **options)), 3), rollout(env, 3))


def test_the_frame_rate_is_that_of_the_steps() -> None:
    assert make().metadata["render_fps"] == 100.0
    assert make(ticks=40).metadata["render_fps"] == 25.0
    assert make(ticks=1, tick_us=500).metadata["render_fps"] == 2000.0


def test_noise_of_the_sensor_follows_from_the_seed_too() -> None:
    # no start is drawn and nothing moves: what differs is the noise alone
    noisy = evs.SensorConfig(preset="ideal", width=24, height=20, shot_noise_rate_hz=50.0)
    env = make("evs/Loop-v0", sensor=noisy, cameras="watch")

    def episode(seed: int) -> list[Any]:
        return [env.reset(seed=seed), *[env.step(np.zeros(1, np.float32)) for _ in range(5)]]

    assert same(episode(1), episode(1))
    assert not same(episode(1), episode(2))


def test_observations_are_the_representations_of_what_arrived() -> None:
    size = (64, 48)
    environments = {kind: make("evs/Reach-v0", observation=kind, size=size) for kind in KINDS}
    so_far = []
    for env in environments.values():
        env.reset(seed=3)
    for number in range(1, 6):
        end_us = number * 10_000
        told = {
            kind: env.step(np.array([0.5, -0.5], np.float32))[0]
            for kind, env in environments.items()
        }
        seen = environments["packet"].seen
        assert seen.t_us == end_us
        events = join_events([packet.events for packet in seen.packets])
        so_far.append(events)
        assert len(events) > 20
        assert np.array_equal(told["event_frame"], event_frame(events, size))
        grid = voxel_grid(events, 5, size, (end_us - 10_000, end_us))
        assert np.array_equal(told["voxel_grid"], grid)
        surface = time_surface(join_events(so_far), size, 30_000.0, end_us)
        assert np.array_equal(told["time_surface"], surface)
        assert np.array_equal(told["packet"], padded_packet(events, 2048, end_us))


def test_delays_are_the_loops() -> None:
    late = evs.DelayConfig(transport_us=30_000, control_us=20_000)
    env = make("evs/Reach-v0", delays=late, size=(64, 48))
    env.reset(seed=3)
    ends = []
    for _ in range(6):
        env.step(np.ones(2, np.float32))
        ends.append([packet.time_end_us for packet in env.seen.packets][-1:])
        # what was decided acts 20 ms later
        assert env.loop.world.data.ctrl.any() == (env.seen.t_us > 20_000)
    assert ends == [[], [], [], [10_000], [20_000], [30_000]]


def test_cameras_and_encoders_are_told_by_name() -> None:
    one = make(encoders=True)
    assert set(one.observation_space.spaces) == {"events", "position", "velocity"}
    two = make("evs/Loop-v0")
    assert set(two.observation_space.spaces) == {"onboard", "watch"}
    seen, _ = one.reset(seed=1)
    assert np.array_equal(seen["position"], one.seen.position.astype(np.float32))
    # motor with gear 20 on the slider: the encoder says 20 times its position
    at = one.loop.world.data.joint("slider").qpos[0]
    assert seen["position"][0] == pytest.approx(20 * at, rel=1e-6)
    assert at != 0


def test_a_left_limit_terminates_and_the_clock_truncates() -> None:
    env = make(max_s=5.0)
    told = rollout(env, 1, steps=1000)
    *_, worth, terminated, truncated, info = told[-1]
    assert (worth, terminated, truncated) == (0.0, True, False)
    assert info["done"].startswith(("angle left", "position left"))
    assert all(step[1:4] == (1.0, False, False) for step in told[1:-1])
    with pytest.raises(EvsError, match="the episode is over"):
        env.step(env.action_space.sample())
    # 25 ms are two steps of 10 ms and one of 5
    short = make("evs/Reach-v0", max_s=0.025)
    assert [step[3] for step in rollout(short, 1)[1:]] == [False, False, True]
    assert short.seen.t_us == 25_000
    with pytest.raises(EvsError, match="the episode is over"):
        short.step(short.action_space.sample())


def test_physics_that_breaks_down_terminates() -> None:
    def start(random: np.random.Generator, data: Any) -> None:
        data.qvel[:] = 1e12

    env = make(start=start, limits={})
    env.reset(seed=1)
    *_, worth, terminated, truncated, info = env.step(np.zeros(1, np.float32))
    assert (terminated, truncated) == (True, False)
    assert info["done"].startswith("unstable at t = 0.000")
    assert np.isfinite(worth)


def test_actions_are_spread_over_the_ranges_of_control() -> None:
    env = make("evs/Reach-v0", control_range={"tilt": (1.0, 2.0)})
    env.reset(seed=1)
    env.step(np.array([0.5, -1.0], np.float32))
    assert env.loop.world.data.ctrl.tolist() == [1.5, 1.0]
    env.step(np.array([7.0, 0.0], np.float32))
    assert env.loop.world.data.ctrl.tolist() == [3.0, 1.5]


def test_a_reward_is_made_of_sensors() -> None:
    by_name = make("evs/Reach-v0", reward={"miss": -2.0}, alive=0.5)
    seen: list[Any] = []

    def reward(sensors: dict[str, Any], control: Any) -> float:
        seen.append((sensors, control))
        return -2.0 * float(np.sqrt((sensors["miss"] ** 2).sum()))

    by_function = make("evs/Reach-v0", reward=reward, alive=0.5)
    first, second = rollout(by_name, 2, 5), rollout(by_function, 2, 5)
    worth = [step[1] for step in first[1:]]
    assert worth == pytest.approx([step[1] for step in second[1:]], rel=1e-12)
    assert len(set(worth)) == 5
    sensors, control = seen[-1]
    assert control.shape == (2,)
    # the sensor as plain geometry: the ball's place, and a point 1 m before the head
    data = by_function.loop.world.data
    pan, tilt, across, up = data.qpos
    aim = [-np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), np.sin(tilt)]
    miss = np.linalg.norm(np.subtract(aim, [across, 1.0, up]))
    assert np.linalg.norm(sensors["miss"]) == pytest.approx(miss, rel=1e-9)


def test_an_episode_begins_where_it_is_told_to() -> None:
    env = make(start={"hinge": (0.2, 0.2)})
    env.reset(seed=1)
    assert env.loop.world.data.joint("hinge").qpos[0] == 0.2
    starts = []
    env = make()
    for seed in range(20):
        env.reset(seed=seed)
        starts.append(env.loop.world.data.joint("hinge").qpos[0])
    assert len(set(starts)) == 20
    assert -0.05 <= min(starts) < -0.02 < 0.02 < max(starts) <= 0.05

    def lean(random: np.random.Generator, data: Any) -> None:
        data.qpos[:] = random.uniform(0.1, 0.2, 2)

    env = make(start=lean)
    env.reset(seed=1)
    assert (env.loop.world.data.qpos > 0.1).all()


def test_an_episode_that_begins_outside_its_limits_is_refused() -> None:
    places = iter([0.2, 0.05])

    def lean(random: np.random.Generator, data: Any) -> None:
        data.joint("hinge").qpos[0] = next(places)

    env = make(limits={"angle": (-0.1, 0.1)}, start=lean)
    with pytest.raises(EvsError, match=r"\(angle left -0.1 ... 0.1\): narrow start, or widen"):
        env.reset(seed=1)
    env.reset(seed=2)
    assert env.step(np.zeros(1, np.float32))[2:4] == (False, False)


def test_the_picture_shows_scene_and_events() -> None:
    assert make().render() is None
    env = make(render_mode="rgb_array")
    env.reset(seed=1)
    before = env.render()
    assert (before.dtype, before.ndim, before.shape[2]) == (np.uint8, 3, 3)
    for _ in range(6):
        env.step(np.ones(1, np.float32))
    after = env.render()
    assert after.shape == before.shape
    # the scene on the left and the events on the right have both changed
    assert (before[:, :480] != after[:, :480]).any()
    assert (before[:, 480:] != after[:, 480:]).any()
    assert np.array_equal(after, env.render())


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"observation": "voxel"}, "no observation 'voxel'; there is: voxel_grid"),
        ({"bins": 0, "observation": "voxel_grid"}, "bins is 0"),
        ({"tau_us": -1.0, "observation": "time_surface"}, "tau_us is -1"),
        ({"capacity": 0, "observation": "packet"}, "capacity is 0"),
        ({"ticks": 0}, "ticks is 0"),
        ({"max_s": 0.0}, "max_s is 0"),
        ({"size": 64}, "size is 64: give"),
        ({"reward": {"hight": 1.0}}, "no sensor 'hight'; there is: position, angle"),
        ({"reward": 3}, "reward is 3; give {sensor: weight}"),
        ({"alive": "much"}, "alive is 'much'"),
        ({"reward": {"angle": "much"}}, "reward.'angle'. is 'much'"),
        ({"start": {"hing": (0, 1)}}, "no joint 'hing'; there is: hinge"),
        ({"start": {"hinge": 0.1}}, "start.'hinge'. is 0.1"),
        ({"limits": {"angl": (0, 1)}}, "no sensor 'angl'"),
        ({"control_range": {"pull": (0, 1)}}, "no actuator 'pull'; there is: push"),
        ({"control_range": {"push": (1, 0)}}, "range of actuator 'push'"),
        ({"scene": "nowhere.xml"}, "no scene file 'nowhere.xml'"),
        ({"cameras": "front"}, "no camera 'front'"),
    ],
)
def test_what_cannot_be_is_one_line(options: dict[str, Any], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        make(**options)


def test_a_render_mode_that_there_is_not_is_refused() -> None:
    with pytest.raises(EvsError, match="render_mode is 'ansi'; give None, human or rgb_array"):
        LoopEnv(CART, render_mode="ansi")


def test_bad_actions_and_options_are_refused_and_nothing_moves() -> None:
    env = make()
    with pytest.raises(EvsError, match="call reset first"):
        env.step(np.zeros(1, np.float32))
    env.reset(seed=1)
    for action, says in ((np.zeros(2), r"shape \(2,\), not \(1,\)"), ([np.nan], "finite")):
        with pytest.raises(EvsError, match=says):
            env.step(action)
    assert env.loop.t_us == 0
    with pytest.raises(EvsError, match="no option 'keyfram'"):
        env.reset(options={"keyfram": "a"})
    with pytest.raises(EvsError, match="no keyframe 'leaning'"):
        env.reset(options={"keyframe": "leaning"})


def test_without_actuators_or_their_ranges_there_are_no_actions(tmp_path: Path) -> None:
    scene = tmp_path / "scene.xml"
    body = "<worldbody><body><joint name='j'/><geom size='.1'/></body></worldbody>"
    scene.write_text(f"<mujoco>{body}</mujoco>")
    with pytest.raises(EvsError, match="no actuators"):
        make("evs/Loop-v0", scene=scene, cameras="", limits={})
    motor = "<actuator><motor name='m' joint='j'/></actuator>"
    scene.write_text(f"<mujoco>{body}{motor}</mujoco>")
    with pytest.raises(EvsError, match="'m' has no ctrlrange"):
        make("evs/Loop-v0", scene=scene, cameras="", limits={})
    env = make("evs/Loop-v0", scene=scene, cameras="", limits={}, control_range={"m": (-2, 2)})
    assert env.action_space.shape == (1,)


def test_a_spec_travels_as_json() -> None:
    spec = make().spec
    assert gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()).kwargs["size"] == [24, 20]
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert same(rollout(again.unwrapped, 3, 5), rollout(make(), 3, 5))


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )


@pytest.mark.integration
def test_gymnasium_finds_them_by_their_module() -> None:
    ran = run(
        "import gymnasium\n"
        "env = gymnasium.make('evs.drivers.gym:evs/CartPole-v0', size=(16, 16))\n"
        "print(env.observation_space.shape)"
    )
    assert ran.stdout == "(2, 16, 16)\n", ran.stderr


def test_without_gymnasium_one_line_says_what_to_install() -> None:
    ran = run(
        "import sys\nsys.modules['gymnasium'] = None\n"
        "from evs.msgs import EvsError\n"
        "try:\n    import evs.drivers.gym\n"
        "except EvsError as reason:\n    print(reason)"
    )
    assert ran.stdout == "Gymnasium is not installed: pip install 'evs[gym]'\n", ran.stderr
