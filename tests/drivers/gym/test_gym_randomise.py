"""Randomised sensors and scenes in environments: from the reset seed, told in info."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import evs
import evs.drivers.gym
from evs.emulator.config import SensorConfig
from evs.msgs import EvsError
from reference.episodes import same

RANGES = {
    "pos_thres": "uniform(0.1, 0.4)",
    "neg_thres": "normal(1, 0.1) * pos_thres",
    "white_lux": "log_uniform(10, 10000)",
    "shot_noise_rate_hz": "log_uniform(0.5, 50)",
}
OPTIONS: dict[str, Any] = {"size": (24, 20), "max_s": 0.2, "sensor": "davis346"}


def make(**options: Any) -> Any:
    return gymnasium.make("evs/CartPole-v0", **{**OPTIONS, **options}).unwrapped


def rollout(env: Any, seed: int | None, steps: int = 15) -> tuple[list[Any], dict[str, float]]:
    """(observations, the sensor in info) of an episode, whose info tells the same in every step."""
    seen, info = env.reset(seed=seed)
    sensor = info.get("sensor")
    found = [seen]
    for step in range(steps):
        seen, _, _, _, info = env.step(np.array([np.sin(step)], np.float32))
        assert info.get("sensor") == sensor
        found.append(seen)
    return found, sensor


@pytest.mark.integration
def test_gymnasiums_checker_has_nothing_to_say() -> None:
    check_env(make(randomise=RANGES))


def test_the_reset_seed_gives_sensor_and_episode_again() -> None:
    env = make(randomise=RANGES)
    first, sensor = rollout(env, 5)
    second, another = rollout(env, None)
    assert set(sensor) == set(RANGES)
    assert all(another[key] != value for key, value in sensor.items())
    assert not same(first, second)
    other = make(randomise=dict(reversed(RANGES.items())))
    for seed, expected in ((5, (first, sensor)), (None, (second, another))):
        found = rollout(other, seed)
        assert same(found[0], expected[0])
        assert found[1] == expected[1]
    assert sum(int(frame.sum()) for frame in first) > 100


def test_the_values_in_info_give_the_episode_again() -> None:
    ranged, sensor = rollout(make(randomise=RANGES), 8)
    fixed = make(sensor=evs.sensor_with_values("davis346", sensor))
    again, told = rollout(fixed, 8)
    assert same(ranged, again)
    # nothing more is told where nothing is drawn
    assert told is None
    assert not same(ranged, rollout(make(), 8)[0])


def test_all_cameras_have_the_sensor_and_each_its_own_pixels() -> None:
    env = make(randomise=RANGES, cameras=("onboard", "onboard"))
    env.reset(seed=1)
    one, other = env.loop.world.cameras
    assert one.sensor == other.sensor
    assert one.sensor.pos_thres == env.drawn.values["pos_thres"]
    assert one.info.config["sensor"]["pos_thres"] == env.drawn.values["pos_thres"]
    assert one.info.seed != other.info.seed


def test_vector_environments_draw_for_each() -> None:
    env = gymnasium.make_vec(
        "evs/CartPole-v0", 3, vectorization_mode="sync", randomise=RANGES, **OPTIONS
    )
    _, info = env.reset(seed=4)
    told = [info["sensor"]["pos_thres"].copy()]
    for _ in range(25):
        *_, info = env.step(np.zeros((3, 1), np.float32))
        told.append(info["sensor"]["pos_thres"].copy())
    env.close()
    # the second of three has the second seed; all begin anew after 20 steps
    single = make(randomise=RANGES)
    first = single.reset(seed=5)[1]["sensor"]["pos_thres"]
    second = single.reset()[1]["sensor"]["pos_thres"]
    assert [values[1] for values in told[:21]] == [first] * 21
    assert [values[1] for values in told[21:]] == [second] * 5
    assert len(set(told[0].tolist())) == 3


@pytest.mark.slow
def test_in_processes_of_their_own_they_draw_the_same() -> None:
    def sensors(mode: str, **more: Any) -> list[Any]:
        env = gymnasium.make_vec(
            "evs/CartPole-v0", 2, vectorization_mode=mode, randomise=RANGES, **OPTIONS, **more
        )
        found = [env.reset(seed=4)[1]["sensor"][key].tolist() for key in sorted(RANGES)]
        env.close()
        return found

    apart = sensors("async", vector_kwargs={"context": "forkserver"})
    assert apart == sensors("sync")


def test_a_file_of_ranges(tmp_path: Path) -> None:
    lines = [f'{key} = "{text}"' for key, text in RANGES.items()]
    file = tmp_path / "ranges.toml"
    scene = ["[randomise.scene]", *(f'"{key}" = "{text}"' for key, text in SCENE.items())]
    own = 'readout.row_ns = "choice(100, 200)"'
    file.write_text("\n".join(["[randomise]", *lines, own, *scene]))
    info = make(randomise=str(file)).reset(seed=5)[1]
    sensor = info["sensor"]
    assert info["scene"] == make(randomise={"scene": SCENE}).reset(seed=5)[1]["scene"]
    expected = make(randomise=RANGES).reset(seed=5)[1]["sensor"]
    assert {key: sensor[key] for key in RANGES} == expected
    assert sensor["readout.row_ns"] in (100, 200)


SCENE = {
    "light.*.brightness": "uniform(0.3, 1)",
    "geom.*.rgb": "uniform(0.1, 1)",
    "body.pole.mass": "uniform(0.5, 2) * nominal",
    "camera.onboard.fovy": "uniform(60, 80)",
    "joint.slider.qvel": "uniform(-1, 1)",
}


def test_a_scene_is_drawn_beside_the_sensor_and_told_in_info() -> None:
    env = make(randomise={**RANGES, "scene": SCENE})
    first, _ = rollout(env, 5)
    scene = env.drawn_scene.values
    assert env.reset(seed=5)[1]["scene"] == scene
    assert scene["body.pole.mass"] == env.loop.world.model.body("pole").mass[0]
    # it changes neither the sensor nor, in its names, the start
    plain = make(randomise=RANGES)
    assert plain.reset(seed=5)[1]["sensor"] == env.reset(seed=5)[1]["sensor"]
    assert plain.loop.world.data.joint("hinge").qpos == env.loop.world.data.joint("hinge").qpos
    assert not same(rollout(plain, 5)[0], first)
    # as keys of one table, as a file has them
    flat = make(randomise={**RANGES, **{f"scene.{key}": text for key, text in SCENE.items()}})
    assert same(rollout(flat, 5)[0], first)
    assert flat.drawn_scene.values == scene
    second = env.reset()[1]["scene"]
    assert all(second[key] != value for key, value in scene.items())


def test_the_values_of_a_scene_give_the_episode_again() -> None:
    ranged = make(randomise={"scene": SCENE})
    expected, _ = rollout(ranged, 8)
    noise = ranged.loop.world.seed
    fixed = make()
    fixed.reset(seed=8)
    start = fixed.loop.world.data.qpos.copy()

    def begin(data: Any) -> None:
        data.qpos[:] = start

    fixed.loop.reset(noise, start=begin, scene=ranged.drawn_scene.values)
    found = []
    for step in range(15):
        seen = fixed.loop.step(fixed._task.control(np.array([np.sin(step)], np.float32)), 10)
        found.append(sum(len(packet.events) for packet in seen.packets))
    ranged.reset(seed=8)
    told = [ranged.step(np.array([np.sin(step)], np.float32))[4]["events"] for step in range(15)]
    assert found == told
    assert sum(told) > 100
    # and a copy goes on with them
    twin = deepcopy(ranged)
    assert twin.drawn_scene == ranged.drawn_scene
    assert twin.loop.world.scene_values == ranged.drawn_scene.values
    ends = [one.step(np.array([0.3], np.float32))[0] for one in (ranged, twin)]
    assert np.array_equal(*ends)
    assert len(expected) == 16


def test_many_worlds_draw_what_single_environments_draw() -> None:
    options = {**OPTIONS, "randomise": {**RANGES, "scene": SCENE}, "max_s": 0.05}
    many = gymnasium.make_vec("evs/CartPole-v0", 3, **options)
    sync = gymnasium.make_vec("evs/CartPole-v0", 3, vectorization_mode="sync", **options)
    random = np.random.default_rng(2)
    for env in (many, sync):
        env.reset(seed=4)
    masses = set()
    # episodes of 5 steps begin again, one after another
    for _ in range(13):
        actions = random.uniform(-1, 1, (3, 1)).astype(np.float32)
        (seen, *rest, info), (expected, *others, told) = (env.step(actions) for env in (many, sync))
        assert np.array_equal(seen, expected)
        assert all(np.array_equal(a, b) for a, b in zip(rest, others, strict=True))
        for name, values in told["scene"].items():
            assert np.array_equal(info["scene"][name], values), name
        masses |= set(info["scene"]["body.pole.mass"].tolist())
    assert len(masses) == 9
    many.close()
    sync.close()


@pytest.mark.parametrize(
    ("randomise", "says"),
    [
        ({"scene": {"body.pol.mass": "uniform(1, 2)"}}, "randomise.scene.body.pol.mass: no body"),
        ({"scene.body.pole.mass": "uniform(0, 2)"}, "0 is outside 1e-12"),
        ({"scene": ["pole"]}, "randomise.scene is"),
        ({"pos_thrs": "uniform(1, 2)"}, "at randomise.pos_thrs: no numeric key of"),
        ({"height": "uniform(10, 20)"}, "one size in all episodes"),
        (["pos_thres"], "randomise is \\['pos_thres'\\]; give"),
        ("nowhere.toml", "no file 'nowhere.toml'"),
    ],
)
def test_mistakes_are_one_line(randomise: Any, says: str) -> None:
    with pytest.raises(EvsError, match=says) as error:
        make(randomise=randomise)
    assert "\n" not in str(error.value)


def test_mistakes_in_a_file_name_the_file(tmp_path: Path) -> None:
    file = tmp_path / "ranges.toml"
    for text, says in (
        ("[randomise]\n", "there is no range"),
        ("[randomise]\npos_thres = 0.3\n", "at randomise.pos_thres: expected a string, got 0.3"),
        ("[sensor]\npos_thres = 0.3\n", "at sensor: unknown key; nearest known: randomise"),
        ("[randomise\n", "malformed TOML"),
    ):
        file.write_text(text)
        with pytest.raises(EvsError, match=says) as error:
            make(randomise=file)
        assert str(error.value).count(str(file)) == 1


def test_the_range_is_of_the_sensor_that_the_environment_has() -> None:
    own = SensorConfig("davis346", pos_thres=0.2)
    env = make(sensor=own, randomise={"pos_thres": "uniform(0.9, 1.1) * nominal"})
    value = env.reset(seed=1)[1]["sensor"]["pos_thres"]
    assert 0.18 <= value <= 0.22
