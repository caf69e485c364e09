"""Where the pole is balanced: gymnasium's own robot, a camera on its cart, starts and pushes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.drivers.run.paths import in_package
from evs.emulator.base.protocols import Meter
from evs.emulator.config import CameraConfig
from evs.emulator.config.closed_loop import DelayConfig
from evs.emulator.simulation.closed_loop import Loop
from evs.emulator.world import MjData, MjModel, add_joint_sensors, load_model, load_spec
from evs.examples.cartpole.controller import Balancer
from evs.examples.cartpole.tracker import Mount
from evs.examples.pushes import Pushes
from evs.msgs import Observation

SCENE = "gymnasium:envs/mujoco/assets/inverted_pendulum.xml"

FALLEN_RAD = 0.8
"""Nothing comes back from there."""
RAIL_M = 0.98
"""The rail ends at 1 m."""

PUSHES = Pushes(first_tick=1000, every_ticks=2000)


class CartPoleLoop(Loop):
    """The loop: a seed says where cart and pole start, and from which side it is pushed."""

    def __init__(
        self,
        *,
        push_ns: float = 0.0,
        delay_ms: float = 0.0,
        max_s: float | None = None,
        threads: int = 1,
        meter: Meter | None = None,
    ) -> None:
        """In: as of Trial; threads, that find light."""
        self.push_ns = push_ns
        super().__init__(
            cartpole_model(),
            camera_on_cart(),
            sensor="dvs128",
            threads=threads,
            meter=meter,
            limits={"angle": (-FALLEN_RAD, FALLEN_RAD), "place": (-RAIL_M, RAIL_M)},
            max_s=max_s,
            delays=DelayConfig(control_us=round(1000 * delay_ms)),
        )
        self._body = int(self.world.model.body("pole").id)

    def reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        state: bool = False,
        start: Callable[[MjData], None] | None = None,
    ) -> Observation:
        """As Loop's; without `start`, the seed draws one. In: seed, None is 0."""
        seed = seed or 0
        random = np.random.default_rng(seed % 2**64)
        place, angle = random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2)

        def drawn(data: MjData) -> None:
            data.joint("slider").qpos[0], data.joint("hinge").qpos[0] = place, angle

        return super().reset(seed, keyframe, state, start or drawn)

    def _tick(self) -> bool:
        random, newton = PUSHES.random(self.world.tick, self.world.seed), 0.0
        if random is not None:
            newton = self.push_ns / PUSHES.seconds * random.choice((-1.0, 1.0))
        # in the middle of the pole
        self.world.data.xfrc_applied[self._body, 0] = newton
        return super()._tick()


@dataclass(frozen=True)
class Trial:
    """One try."""

    seed: int = 0
    """start, sides of pushes, the camera's noise"""
    push_ns: float = 1.0
    """impulse on the pole's middle every 2 s, N s"""
    delay_ms: float = 0.0
    """how much later than decided a force acts"""
    seconds: float = 10.0


@dataclass(frozen=True)
class Outcome:
    """What came of it."""

    stood_s: float
    ended: str
    """why it ended before its time; "": it stood"""
    lean_rad: float
    """root mean square of the pole's angle"""


Watch = Callable[[Observation, Balancer], None]
"""Sees each tick of a trial, for pictures."""


def play(loop: CartPoleLoop, trial: Trial, watch: Watch | None = None) -> Outcome:
    """Balance until it has fallen or time is over. In: loop, made with the trial's delay."""
    controller = Balancer()
    loop.push_ns = trial.push_ns
    seen = loop.reset(trial.seed)
    ticks, tick, lean = max(1, round(trial.seconds * 1000)), 0, 0.0
    while tick < ticks and not seen.done:
        seen = loop.step(controller.decide(seen))
        tick += 1
        lean += float(loop.world.data.joint("hinge").qpos[0]) ** 2
        if watch is not None:
            watch(seen, controller)
    return Outcome(tick * 1e-3, seen.done, float(np.sqrt(lean / tick)))


def cartpole_model() -> MjModel:
    """Gymnasium's inverted pendulum, with sensors for who judges: angle and place. EvsError."""
    spec = load_spec(in_package(SCENE))
    add_joint_sensors(spec, {"angle": "hinge", "place": "slider"})
    return load_model(spec)


def camera_on_cart(mount: Mount | None = None) -> CameraConfig:
    """A camera that rides along beside the pole and looks straight at its plane."""
    mount = mount or Mount()
    return CameraConfig(
        body="cart",
        pos=(0.0, -mount.distance_m, mount.height_m),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        fovy=mount.fovy_deg,
    )
