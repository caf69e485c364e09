"""One host library seen by an event camera, and what that costs: a line of JSON.

    python host_probe.py HOST

Run by matrix.py in an environment of its own for each host and version.
"""

from __future__ import annotations

import importlib.metadata
import json
import statistics
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import mujoco
import numpy as np

import evs
from evs.drivers.environments.physics import find_physics

STEPS = 60
"""timed of each kind"""

PENCIL = Path(evs.__file__).parent / "config" / "scenes" / "pencil.xml"


def observed(model: Any, step: Callable[[], Any], camera: str = "") -> dict[str, Any]:
    """Time of a step, and of the observation of the data that it returns."""
    eye = evs.EventCamera(model, camera=camera)
    steps_ms, looks_ms, events = [], [], 0
    for number in range(STEPS + 5):
        began = perf_counter()
        data = step()
        stepped = perf_counter()
        events += len(eye.observe(data))
        if number >= 5:
            steps_ms.append(1e3 * (stepped - began))
            looks_ms.append(1e3 * (perf_counter() - stepped))
    return {
        "step_ms": statistics.median(steps_ms),
        "observe_ms": statistics.median(looks_ms),
        "observations": 1,
        "events": events,
    }


def wrapped(make: Callable[[], Any], action: Callable[[Any], Any], camera: str) -> dict[str, Any]:
    """Time of a step of the environment alone, and of one that is seen in every sub-step."""
    times = {}
    events = 0
    for name, env in (("plain", make()), ("seen", evs.wrap(make(), camera))):
        env.reset()
        given = action(env)
        taken = []
        for number in range(STEPS + 5):
            began = perf_counter()
            env.step(given)
            if number >= 5:
                taken.append(1e3 * (perf_counter() - began))
            events += len(env.events) if name == "seen" else 0
        times[name] = statistics.median(taken)
        model, data = find_physics(env)
        begun = data.time
        env.step(given)
        substeps = max(1, round((data.time - begun) / model.opt.timestep))
    return {
        "step_ms": times["plain"],
        "observe_ms": (times["seen"] - times["plain"]) / substeps,
        "observations": substeps,
        "events": events,
    }


def fixed(value: float) -> Callable[[Any], Any]:
    """An action that is the same in every step."""

    def action(env: Any) -> Any:
        if hasattr(env, "action_spec") and not hasattr(env, "action_space"):
            spec = env.action_spec
            return np.full(spec().shape if callable(spec) else np.shape(spec[0]), value)
        return np.full(env.action_space.shape, value, env.action_space.dtype)

    return action


def plain_mujoco() -> dict[str, Any]:
    """MuJoCo in a loop of one's own."""
    model = mujoco.MjModel.from_xml_path(str(PENCIL))
    data = mujoco.MjData(model)

    def step() -> Any:
        mujoco.mj_step(model, data)
        return data

    return observed(model, step)


def gymnasium() -> dict[str, Any]:
    """An ant of Gymnasium."""
    import gymnasium

    return wrapped(lambda: gymnasium.make("Ant-v5"), fixed(0.5), "track")


def gymnasium_robotics() -> dict[str, Any]:
    """A Fetch arm of Gymnasium-Robotics."""
    import gymnasium
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    return wrapped(lambda: gymnasium.make("FetchPickAndPlace-v4"), fixed(0.5), "external_camera_0")


def metaworld() -> dict[str, Any]:
    """A Sawyer arm of Metaworld."""
    import gymnasium
    import metaworld  # noqa: F401

    return wrapped(
        lambda: gymnasium.make("Meta-World/MT1", env_name="reach-v3", seed=0),
        fixed(0.5),
        "topview",
    )


def robosuite() -> dict[str, Any]:
    """A Panda of robosuite."""
    import robosuite

    def make() -> Any:
        return robosuite.make(
            "Lift",
            robots="Panda",
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
        )

    return wrapped(make, lambda env: np.full(env.action_dim, 0.5), "agentview")


def dm_control() -> dict[str, Any]:
    """The humanoid of dm_control's suite."""
    from dm_control import suite

    return wrapped(
        lambda: suite.load("humanoid", "walk", task_kwargs={"random": 0}), fixed(0.5), "side"
    )


def mujoco_playground() -> dict[str, Any]:
    """A cart-pole of MuJoCo Playground, whose state is copied into MuJoCo's own data."""
    import jax
    from mujoco import mjx
    from mujoco_playground import registry

    env = registry.load("CartpoleSwingup")
    advance = jax.jit(env.step)
    state = [jax.jit(env.reset)(jax.random.PRNGKey(0))]
    action = jax.numpy.full(env.action_size, 0.5)

    def step() -> Any:
        state[0] = advance(state[0], action)
        return mjx.get_data(env.mj_model, state[0].data)

    return observed(env.mj_model, step, "fixed")


def mujoco_warp() -> dict[str, Any]:
    """The pencil on MuJoCo Warp, without a GPU, whose state is copied into MuJoCo's own data."""
    import mujoco_warp

    model = mujoco.MjModel.from_xml_path(str(PENCIL))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    there, state = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data)

    def step() -> Any:
        mujoco_warp.step(there, state)
        mujoco_warp.get_data_into(data, model, state)
        return data

    return observed(model, step)


HOSTS = {
    "mujoco": plain_mujoco,
    "gymnasium": gymnasium,
    "gymnasium-robotics": gymnasium_robotics,
    "metaworld": metaworld,
    "robosuite": robosuite,
    "dm_control": dm_control,
    "playground": mujoco_playground,
    "mujoco-warp": mujoco_warp,
}
"""package -> what looks at it"""

if __name__ == "__main__":
    host = sys.argv[1]
    found = HOSTS[host]()
    versions = {name: importlib.metadata.version(name) for name in ("mujoco", "numpy", "evs", host)}
    print(json.dumps({**found, "versions": versions}))
