"""Randomised sensors in the environments: reproducible from the reset seed, told in info."""

from __future__ import annotations

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


def same(one: list[Any], other: list[Any]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


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
    file.write_text("\n".join(["[randomise]", *lines, 'readout.row_ns = "choice(100, 200)"']))
    sensor = make(randomise=str(file)).reset(seed=5)[1]["sensor"]
    expected = make(randomise=RANGES).reset(seed=5)[1]["sensor"]
    assert {key: sensor[key] for key in RANGES} == expected
    assert sensor["readout.row_ns"] in (100, 200)


@pytest.mark.parametrize(
    ("randomise", "says"),
    [
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
