"""The environment: gymnasium's inverted pendulum, a camera on its cart, starts and pushes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.package_paths import in_package
from evs.emulator.base.protocols import Meter
from evs.emulator.config import CameraConfig
from evs.emulator.config.schema import DelayConfig
from evs.emulator.world import MjData, MjModel, add_joint_sensors, load_model, load_spec
from evs.examples.cartpole.controller import CartPoleController
from evs.examples.cartpole.tracker import CameraMount
from evs.examples.common.environment import PushSchedule, SeededLoop
from evs.msgs import Observation

SCENE = "gymnasium:envs/mujoco/assets/inverted_pendulum.xml"

FALLEN_RAD = 0.8
"""the pole cannot be saved beyond it"""
RAIL_M = 0.98
"""the rail ends at 1 m"""

PUSHES = PushSchedule(first_tick=1000, every_ticks=2000)


class CartPoleLoop(SeededLoop):
    """The closed loop. The seed draws the start and the sides of the pushes."""

    def __init__(
        self,
        *,
        push_ns: float = 0.0,
        delay_ms: float = 0.0,
        max_s: float | None = None,
        threads: int = 1,
        meter: Meter | None = None,
    ) -> None:
        """Build the scene.

        Args:
            push_ns: impulse of each push, as in CartPoleTrial.
            delay_ms: delay from a decision to its force, as in CartPoleTrial.
            max_s: length of an episode; None: no limit.
            threads: threads that trace light.
            meter: measures the stages of a tick.
        """
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

    def _draw_start(self, random: np.random.Generator) -> Callable[[MjData], None]:
        place, angle = random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2)

        def drawn(data: MjData) -> None:
            data.joint("slider").qpos[0], data.joint("hinge").qpos[0] = place, angle

        return drawn

    def _tick(self) -> bool:
        random, newton = PUSHES.random(self.world.tick, self.world.seed), 0.0
        if random is not None:
            newton = self.push_ns / PUSHES.seconds * random.choice((-1.0, 1.0))
        # in the middle of the pole
        self.world.data.xfrc_applied[self._body, 0] = newton
        return super()._tick()


@dataclass(frozen=True)
class CartPoleTrial:
    """Settings of one trial."""

    seed: int = 0
    """start, sides of pushes, the camera's noise"""
    push_ns: float = 1.0
    """impulse on the pole's middle every 2 s, N s"""
    delay_ms: float = 0.0
    """delay from a decision to its force"""
    seconds: float = 10.0


@dataclass(frozen=True)
class CartPoleResult:
    """The result of a trial."""

    stood_s: float
    ended: str
    """why it ended early; empty: the pole stood"""
    lean_rad: float
    """root mean square of the pole's angle"""


Watch = Callable[[Observation, CartPoleController], None]
"""called after each tick of a trial"""


def play(loop: CartPoleLoop, trial: CartPoleTrial, watch: Watch | None = None) -> CartPoleResult:
    """Run one trial, until the pole has fallen or the time is over.

    Args:
        loop: made with the delay of the trial.
        trial: its settings.
        watch: called after each tick.
    """
    controller = CartPoleController()
    loop.push_ns = trial.push_ns
    observation = loop.reset(trial.seed)
    ticks, tick, lean = max(1, round(trial.seconds * 1000)), 0, 0.0
    while tick < ticks and not observation.done:
        observation = loop.step(controller.decide(observation))
        tick += 1
        lean += float(loop.world.data.joint("hinge").qpos[0]) ** 2
        if watch is not None:
            watch(observation, controller)
    return CartPoleResult(tick * 1e-3, observation.done, float(np.sqrt(lean / tick)))


def cartpole_model() -> MjModel:
    """Gymnasium's inverted pendulum with sensors for the limits: angle and place."""
    spec = load_spec(in_package(SCENE))
    add_joint_sensors(spec, {"angle": "hinge", "place": "slider"})
    return load_model(spec)


def camera_on_cart(mount: CameraMount | None = None) -> CameraConfig:
    """A camera on the cart that looks straight at the plane of the pole."""
    mount = mount or CameraMount()
    return CameraConfig(
        body="cart",
        pos=(0.0, -mount.distance_m, mount.height_m),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        fovy=mount.fovy_deg,
    )
