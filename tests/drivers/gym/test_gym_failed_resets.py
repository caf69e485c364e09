"""A reset that fails leaves an environment, or many of them, in the episodes that they are in."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

import evs.drivers.gym
from evs.msgs import EvsError
from reference.episodes import same
from reference.worlds_alone import SWING

FAR = """<light name="far" pos="0 -1 9" dir="0 0 1" cutoff="5" diffuse="1e35 1e35 1e35"
  specular="0 0 0"/>"""
TOO_BRIGHT = {"light.far.brightness": "choice(1, 1e9)", "body.arm.mass": "uniform(1, 2)"}
"""in half of the episodes, light that no renderer takes"""

pytestmark = [
    pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning"),
    pytest.mark.slow,
]


def start(random: np.random.Generator, data: Any) -> None:
    """Somewhere, in a fifth of the episodes beyond the limits."""
    data.qpos[0] = random.uniform(-1.0, 1.5)


OPTIONS: dict[str, Any] = {
    "scene": mujoco.MjModel.from_xml_string(SWING.replace("<body", FAR + "<body", 1)),
    "cameras": "left",
    "size": (24, 20),
    "observation": "time_surface",
    "encoders": True,
    "start": start,
    "limits": {"angle": (-2.0, 1.0)},
    "max_s": 0.4,
    "randomise": {"scene": TOO_BRIGHT, "pos_thres": "uniform(0.1, 0.3)"},
}
WHY = {"scene": "diffuse of light 'far' is inf", "limit": "the episode is over where it begins"}


def failing_seeds(env: Any) -> dict[str, int]:
    """A seed for each way to fail."""
    found: dict[str, int] = {}
    for seed in range(200):
        try:
            env.reset(seed=seed)
        except EvsError as error:
            for name, text in WHY.items():
                if text in str(error):
                    found.setdefault(name, seed)
    assert {*found} == {*WHY}
    return found


def good_seed(env: Any, above: int) -> int:
    """The first seed above one with which a reset succeeds."""
    for seed in range(above, above + 50):
        try:
            env.reset(seed=seed)
        except EvsError:
            continue
        return seed
    raise AssertionError


@pytest.mark.parametrize("why", WHY)
def test_an_environment_goes_on_in_its_episode(why: str) -> None:
    env, other = (evs.drivers.gym.LoopEnv(**OPTIONS) for _ in range(2))
    bad = failing_seeds(env)[why]
    good = good_seed(env, 300)
    action = np.array([0.4], np.float32)
    with pytest.raises(EvsError, match="call reset first"):
        other.step(action)
    for one in (env, other):
        one.reset(seed=good)
        one.step(action)
    drawn, scene = env.drawn, env.drawn_scene
    for _ in range(2):
        with pytest.raises(EvsError, match=WHY[why]):
            env.reset(seed=bad)
    assert (env.drawn, env.drawn_scene) == (drawn, scene)
    for _ in range(5):
        assert same(env.step(action), other.step(action))
    # the random numbers are those that come next without the failed resets
    for _ in range(12):
        outcomes = []
        for one in (env, other):
            try:
                outcomes.append(one.reset())
            except EvsError as error:
                one.np_random.random()
                outcomes.append(str(error))
        if isinstance(outcomes[0], str):
            assert outcomes[0] == outcomes[1]
        else:
            assert same(*outcomes)


@pytest.mark.parametrize("why", WHY)
def test_many_environments_go_on_in_their_episodes(why: str) -> None:
    def make() -> Any:
        return gymnasium.make_vec("evs/Loop-v0", 3, **OPTIONS, autoreset_mode="Disabled")

    single = evs.drivers.gym.LoopEnv(**OPTIONS)
    bad = failing_seeds(single)[why]
    seeds = [good_seed(single, above) for above in (300, 400, 500)]
    env, other = make(), make()
    actions = np.full((3, 1), 0.4, np.float32)
    for one in (env, other):
        one.reset(seed=seeds)
        one.step(actions)
    worlds = env.unwrapped.worlds
    masses = [worlds.world(n).scene_values["body.arm.mass"] for n in range(3)]
    mask = np.array([True, False, True])
    for options in ({}, {"reset_mask": mask}):
        with pytest.raises(EvsError, match=WHY[why]):
            env.reset(seed=[seeds[1], seeds[0], bad], options=options)
    assert [worlds.world(n).scene_values["body.arm.mass"] for n in range(3)] == masses
    assert [drawn.values["body.arm.mass"] for drawn in env.unwrapped.drawn_scenes] == masses
    for _ in range(3):
        assert same(env.step(actions), other.step(actions))
    # whether they fail or not, the episodes that come next are the same
    for _ in range(8):
        outcomes = []
        for one in (env, other):
            try:
                outcomes.append(one.reset(options={"reset_mask": mask}))
            except EvsError as error:
                outcomes.append(str(error))
                for random in one.unwrapped._random:
                    random.random()
        assert type(outcomes[0]) is type(outcomes[1])
        assert isinstance(outcomes[0], str) or same(*outcomes)
        assert same(*(one.unwrapped.worlds.save()[1:2] for one in (env, other)))
    env.close()
    other.close()
