"""LoopVectorEnv: in one process and of one Worlds, the bytes of SyncVectorEnv of LoopEnv."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import evs
import evs.drivers.gym  # registers the environments
from evs.drivers.gym import LoopVectorEnv
from evs.emulator.simulation.stacked_arrays import KINDS
from evs.msgs import EvsError

CART, REACH = "evs/CartPole-v0", "evs/Reach-v0"
SMALL: dict[str, Any] = {"size": (24, 20), "max_s": 0.15}


def check_same(one: Any, other: Any, where: str) -> None:
    """Same bits, types and shapes, all the way down."""
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            check_same(one[key], other[key], f"{where}/{key}")
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for place, (a, b) in enumerate(zip(one, other, strict=True)):
            check_same(a, b, f"{where}[{place}]")
    elif isinstance(one, np.ndarray) and one.dtype == object:
        check_same(list(one), list(other), where)
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape), where
        assert np.array_equal(one, other), where
    else:
        assert type(one) is type(other), where
        assert one == other, where


def check_same_episodes(
    name: str, mode: AutoresetMode, steps: int, **options: Any
) -> LoopVectorEnv:
    """Step both kinds of vector with the same actions; at least one episode has to end."""
    options = {**SMALL, **options}
    kind = "vector_entry_point"
    ours = gymnasium.make_vec(name, 3, vectorization_mode=kind, autoreset_mode=mode, **options)
    modes = {"autoreset_mode": mode}
    # it takes no autoreset_mode itself
    theirs = gymnasium.make_vec(name, 3, vectorization_mode="sync", vector_kwargs=modes, **options)
    for space in ("observation_space", "action_space", "single_observation_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.metadata == {**theirs.metadata, "render_modes": []}
    check_same(ours.reset(seed=4), theirs.reset(seed=4), "reset")
    random, ended = np.random.default_rng(7), 0
    for step in range(steps):
        actions = random.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        told = ours.step(actions)
        check_same(told, theirs.step(actions), f"step {step}")
        over = told[2] | told[3]
        ended += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            again = [one.reset(options={"reset_mask": over.copy()}) for one in (ours, theirs)]
            check_same(*again, f"reset after {step}")
    assert ended
    # a second reset goes on with the random numbers
    check_same(ours.reset(), theirs.reset(), "second reset")
    ours.close()
    return ours.unwrapped


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize(
    "kind", [KINDS[0], *(pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS[1:])]
)
def test_every_observation_and_autoreset_is_that_of_single_ones(
    kind: str, mode: AutoresetMode
) -> None:
    made = check_same_episodes(CART, mode, 18, observation=kind, encoders=kind == "packet")
    assert made.worlds.one_by_one == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        # limits end episodes within steps, one environment before the other
        {"limits": {"angle": (-0.03, 0.03)}, "start": {"hinge": (-0.02, 0.02)}, "max_s": 5.0},
        # a readout, noise, and other sensors in every episode
        {"sensor": "dvs128", "randomise": {"pos_thres": "uniform(0.1, 0.3)"}},
        {"cameras": ("onboard", "watch"), "encoders": True},
        {"reward": lambda sensors, control: sensors["angle"][0] + control[0], "alive": 0.5},
        # steps that the time cuts short
        {"ticks": 7, "max_s": 0.05},
        {"render": evs.RenderConfig(renderer="path", spp=1, seeds="fresh"), "max_s": 0.03},
    ],
    ids=["limits", "randomise", "cameras", "reward", "short", "one by one"],
)
def test_every_option_is_that_of_single_ones(options: dict[str, Any]) -> None:
    check_same_episodes(CART, AutoresetMode.SAME_STEP, 16, **options)


def test_rewards_of_sensors_are_those_of_single_ones() -> None:
    made = check_same_episodes(REACH, AutoresetMode.NEXT_STEP, 18)
    assert made.worlds.readings["miss"].shape[0] == 3


def test_make_vec_takes_names_and_scenes() -> None:
    named = evs.make_vec(CART, 2, **SMALL)
    assert isinstance(named.unwrapped, LoopVectorEnv)
    assert named.reset(seed=1)[0].shape == (2, 2, 20, 24)
    own = evs.make_vec("evs:config/scenes/pantilt.xml", 2, cameras="eye", **SMALL)
    assert own.reset(seed=1)[0].shape == (2, 2, 20, 24)
    # gymnasium's own way takes it where nothing else is asked for
    assert isinstance(gymnasium.make_vec(CART, 2, **SMALL).unwrapped, LoopVectorEnv)


def test_without_copies_observations_are_one_memory() -> None:
    envs = evs.make_vec(CART, 2, observation="voxel_grid", copy=False, **SMALL)
    first, _ = envs.reset(seed=1)
    second, *_ = envs.step(np.ones((2, 1), np.float32))
    assert np.shares_memory(first, second)
    assert np.shares_memory(np.from_dlpack(second), second)
    copies = evs.make_vec(CART, 2, observation="voxel_grid", **SMALL)
    first, _ = copies.reset(seed=1)
    second, *_ = copies.step(np.ones((2, 1), np.float32))
    assert not np.shares_memory(first, second)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"render_mode": "rgb_array"}, "no picture.*sync"),
        ({"autoreset_mode": "never"}, "autoreset_mode is 'never'.*NextStep"),
        ({"num_envs": 0}, "count is 0"),
        ({"observation": "film"}, "film"),
        ({"limits": {"speed": (0, 1)}}, "speed"),
        ({"start": {"hinge": (1.0, 1.1)}, "limits": {"angle": (-0.1, 0.1)}}, ""),
    ],
)
def test_bad_arguments_are_refused_in_a_line(options: dict[str, Any], words: str) -> None:
    if not words:
        envs = LoopVectorEnv("evs:config/scenes/cartpole.xml", num_envs=2, **SMALL, **options)
        with pytest.raises(EvsError, match="over where it begins"):
            envs.reset(seed=1)
        return
    with pytest.raises(EvsError, match=words) as refusal:
        LoopVectorEnv("evs:config/scenes/cartpole.xml", **{**SMALL, **options})
    assert "\n" not in str(refusal.value)


def test_what_is_over_or_has_not_begun_is_not_stepped() -> None:
    action = np.zeros((2, 1), np.float32)
    envs = evs.make_vec(CART, 2, autoreset_mode="Disabled", **SMALL)
    with pytest.raises(EvsError, match="environment 0 is over, or has not begun: call reset"):
        envs.step(action)
    envs.reset(seed=1)
    with pytest.raises(EvsError, match="give 2 rows"):
        envs.step(np.zeros((3, 1), np.float32))
    with pytest.raises(EvsError, match="reset_mask"):
        envs.reset(options={"reset_mask": np.zeros(2, bool)})
    with pytest.raises(EvsError, match="no option 'speed'"):
        envs.reset(options={"speed": 1})
    with pytest.raises(EvsError, match="3 seeds for 2 environments"):
        envs.reset(seed=[1, 2, 3])
