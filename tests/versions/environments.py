"""Environments of the libraries that robots are trained in, seen by an event camera.

Each needs packages that do not go together with the others', so each test runs in an environment
of its own: `sh .ci/versions.sh`. docs/howto/environments.md shows the same lines.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.environments.physics import find_physics

pytestmark = pytest.mark.filterwarnings("default")


def watch(env: Any, action: Callable[[], Any], camera: str = "", every: str = "substep") -> Any:
    """A few steps are seen: a picture with something in it, and events where something moves."""
    sensor = evs.SensorConfig("davis346", width=128, height=96)
    env = evs.wrap(env, camera, every=every, sensor=sensor)
    env.reset()
    assert len(env.events) == 0
    events = []
    for _ in range(10):
        env.step(action())
        events.append(env.events)
    times = np.concatenate([part["t"] for part in events])
    assert len(times) > 100
    assert (np.diff(times) >= 0).all()
    seen = env.event_camera.packet
    assert times[-1] <= seen.time_end_us
    light = env.event_camera.luminance
    assert np.isfinite(light).all()
    # neither black nor one grey
    assert 0.01 < light.mean() < 10.0
    assert light.std() > 0.02 * light.mean()
    # substeps are seen as substeps
    duration_us = seen.time_end_us - seen.time_base_us
    model, _ = find_physics(env)
    step_us = 1e6 * model.opt.timestep
    assert duration_us == pytest.approx(step_us, abs=1) or every == "step"
    return env


def refused(thing: Any, says: str) -> None:
    with pytest.raises(evs.EvsError, match=says):
        evs.EventCamera(thing)


def test_metaworld() -> None:
    import gymnasium
    import metaworld  # noqa: F401

    env = gymnasium.make("Meta-World/MT1", env_name="reach-v3", seed=0)
    env.action_space.seed(0)
    watch(env, env.action_space.sample, "topview")
    # flags of its own pictures
    renderer = env.unwrapped.mujoco_renderer
    renderer._vopt = {int(mujoco.mjtVisFlag.mjVIS_STATIC): False}
    seen = evs.wrap(env, "topview", sensor="dvs128").event_camera
    ids = seen.ground_truth().geom_id
    model = env.unwrapped.model
    assert (ids >= 0).any()
    assert (model.body_weldid[model.geom_bodyid[ids[ids >= 0]]] != 0).all()
    refused(env, r"env.unwrapped.model \(Metaworld too\)")


@pytest.mark.parametrize("hard_reset", [False, True])
def test_robosuite(hard_reset: bool) -> None:
    import robosuite

    env = robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        hard_reset=hard_reset,
    )
    action = np.full(env.action_dim, 0.5)
    seen = watch(env, lambda: action, "agentview")
    before = seen.event_camera
    # robosuite's cameras show visual geoms (group 1), not those that collide (group 0)
    ids = seen.event_camera.ground_truth().geom_id
    groups = env.sim.model._model.geom_group[ids[ids >= 0]]
    assert len(groups) > 1000
    assert set(groups.tolist()) == {1}
    # a soft reset keeps the model, a hard one compiles another
    seen.reset()
    assert (seen.event_camera is before) is not hard_reset
    seen.step(action)
    assert len(seen.events)
    refused(env.sim.model, "robosuite: env.sim.model._model")


@pytest.mark.parametrize("name", ["FetchPickAndPlace-v4", "HandReach-v3", "AdroitHandDoor-v1"])
def test_gymnasium_robotics(name: str) -> None:
    import gymnasium
    import gymnasium_robotics  # noqa: F401

    env = gymnasium.make(name)
    env.action_space.seed(0)
    watch(env, env.action_space.sample)
    refused(env, "gymnasium: env.unwrapped.model")


@pytest.mark.parametrize("name", [("humanoid", "walk"), ("quadruped", "walk")])
@pytest.mark.parametrize("every", ["substep", "step"])
def test_dm_control(name: tuple[str, str], every: str) -> None:
    from dm_control import suite

    env = suite.load(*name, task_kwargs={"random": 0})
    action = np.full(env.action_spec().shape, 0.5)
    watch(env, lambda: action, every=every)
    refused(env.physics.model, "dm_control: physics.model.ptr")


def test_dm_control_scene_option() -> None:
    from dm_control import suite
    from dm_control.mujoco.wrapper import MjvOption
    from dm_control.suite.wrappers import pixels

    option = MjvOption()
    option.flags[int(mujoco.mjtVisFlag.mjVIS_STATIC)] = 0
    # its pictures need OpenGL, and a camera of ours does not
    env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
    layer = pixels.Wrapper.__new__(pixels.Wrapper)
    layer._env, layer._render_kwargs = env, {"scene_option": option, "camera_id": "side"}
    camera = evs.wrap(layer, "side", sensor="dvs128").event_camera
    ids = camera.ground_truth().geom_id
    model = env.physics.model
    assert (ids >= 0).any()
    assert (model.body_weldid[model.geom_bodyid[ids[ids >= 0]]] != 0).all()


def test_dm_control_recompiled() -> None:
    from dm_control import suite

    env = suite.load("swimmer", "swimmer6", task_kwargs={"random": 0})
    seen = watch(env, lambda: np.full(5, 0.5))
    before = seen.event_camera
    xml, assets = suite.swimmer.get_model_and_assets(8)
    env.physics.reload_from_xml_string(xml, assets)
    env.physics.forward()
    seen.reset()
    assert seen.event_camera is not before
    seen.step(np.full(7, 0.5))
    assert seen.event_camera.packet.time_end_us == round(env.physics.data.time * 1e6)
