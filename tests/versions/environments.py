"""Environments of the libraries that robots are trained in, seen by an event camera.

Each needs packages that do not go together with the others', so each test runs in an environment
of its own: `sh .ci/versions.sh`. docs/howto/environments.md shows the same lines.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import evs

pytestmark = pytest.mark.filterwarnings("default")


def watch(model: Any, data: Any, step: Callable[[], Any], camera: str = "") -> evs.Sensor:
    """A few steps are seen: a picture with something in it, and events where something moves."""
    sensor = evs.Sensor(model, camera, sensor=evs.SensorConfig("davis346", width=128, height=96))
    assert len(sensor.observe(data)) == 0
    events = []
    for _ in range(10):
        step()
        events.append(sensor.observe(data))
    times = np.concatenate([part["t"] for part in events])
    assert len(times) > 100
    assert (np.diff(times) >= 0).all()
    assert times[-1] <= round(data.time * 1e6)
    light = sensor.luminance
    assert np.isfinite(light).all()
    # neither black nor one grey
    assert 0.01 < light.mean() < 10.0
    assert light.std() > 0.02 * light.mean()
    return sensor


def refused(thing: Any, says: str) -> None:
    with pytest.raises(evs.EvsError, match=says):
        evs.Sensor(thing)


def test_metaworld() -> None:
    import gymnasium
    import metaworld  # noqa: F401

    env = gymnasium.make("Meta-World/MT1", env_name="reach-v3", seed=0)
    env.reset(seed=0)
    env.action_space.seed(0)
    inner = env.unwrapped
    watch(inner.model, inner.data, lambda: env.step(env.action_space.sample()), "topview")
    refused(env, r"env.unwrapped.model \(Metaworld too\)")


def test_robosuite() -> None:
    import robosuite

    env = robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        hard_reset=False,
    )
    env.reset()
    action = np.full(env.action_dim, 0.5)
    model, data = env.sim.model._model, env.sim.data._data
    watch(model, data, lambda: env.step(action), "agentview")
    # a soft reset keeps the model, and the data
    env.reset()
    assert (env.sim.model._model, env.sim.data._data) == (model, data)
    refused(env.sim.model, "robosuite: env.sim.model._model")


@pytest.mark.parametrize("name", ["FetchPickAndPlace-v4", "HandReach-v3", "AdroitHandDoor-v1"])
def test_gymnasium_robotics(name: str) -> None:
    import gymnasium
    import gymnasium_robotics  # noqa: F401

    env = gymnasium.make(name)
    env.reset(seed=0)
    env.action_space.seed(0)
    inner = env.unwrapped
    watch(inner.model, inner.data, lambda: env.step(env.action_space.sample()))
    refused(env, "gymnasium: env.unwrapped.model")


@pytest.mark.parametrize("name", [("humanoid", "walk"), ("quadruped", "walk")])
def test_dm_control(name: tuple[str, str]) -> None:
    from dm_control import suite

    env = suite.load(*name, task_kwargs={"random": 0})
    env.reset()
    action = np.full(env.action_spec().shape, 0.5)
    physics = env.physics
    watch(physics.model.ptr, physics.data.ptr, lambda: env.step(action))
    refused(physics.model, "dm_control: physics.model.ptr")
