"""Registers the environments for `gymnasium.make`; importing the module is enough."""

from __future__ import annotations

from typing import Any

from evs.drivers.gym.library import gymnasium

LOOP_ENV = "evs.drivers.gym.loop_env:LoopEnv"
LOOP_VECTOR_ENV = "evs.drivers.gym.loop_vector_env:LoopVectorEnv"

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    # a pole on a cart, seen from the cart: 1 for each step that it stands
    "evs/CartPole-v0": {
        "scene": "evs:config/scenes/cartpole.xml",
        "cameras": "onboard",
        "limits": {"angle": (-0.6, 0.6), "position": (-0.95, 0.95)},
        "start": {"hinge": (-0.05, 0.05), "slider": (-0.05, 0.05)},
        "render_camera": "watch",
    },
    # a camera on a pan-tilt head that has to keep a swinging ball on its axis
    "evs/Reach-v0": {
        "scene": "evs:config/scenes/pantilt.xml",
        "cameras": "eye",
        "start": {"across": (-0.35, 0.35), "up": (-0.35, 0.35)},
        "reward": {"miss": -1.0},
        "render_camera": "watch",
    },
    # any scene of yours: gymnasium.make("evs/Loop-v0", scene="robot.xml", cameras="wrist", ...)
    "evs/Loop-v0": {},
}
"""name -> arguments of LoopEnv, each of which `make` may override. Plain values, since a spec is
written as JSON."""


def register_all() -> None:
    """Register the environments that are not registered yet."""
    for name, arguments in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name, entry_point=LOOP_ENV, vector_entry_point=LOOP_VECTOR_ENV, kwargs=arguments
            )


# Gymnasium's way: importing the module registers its environments
register_all()
