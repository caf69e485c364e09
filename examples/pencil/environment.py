"""The environment: a stick on a cart, two cameras, starts and pushes; runs trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.emulator.base.protocols import Meter
from evs.emulator.config.schema import DelayConfig
from evs.emulator.world import MjData, MjModel, load_model, load_spec
from evs.examples.common.environment import PushSchedule, SeededLoop, sensor_of
from evs.examples.pencil import TRACKERS
from evs.examples.pencil.balance import StickGains
from evs.examples.pencil.controller import CAMERAS, Controller, make_tracker
from evs.msgs import EvsError, Observation, unknown

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "pencil.xml"

LENGTH_M = 0.2
"""of the pencil in the scene"""

FALLEN_RAD = 0.7
"""the stick cannot be saved beyond it"""

PUSHES = PushSchedule(first_tick=500, every_ticks=1000)


class PencilLoop(SeededLoop):
    """The closed loop. The seed draws the start and the directions of the pushes."""

    def __init__(
        self,
        fps: int = 0,
        length_m: float = LENGTH_M,
        *,
        push_mns: float = 0.0,
        delay_ms: float = 0.0,
        max_s: float | None = None,
        threads: int = 1,
        meter: Meter | None = None,
    ) -> None:
        """Build the scene.

        Args:
            fps: frames per second of the cameras; 0: events alone.
            length_m: of the stick.
            push_mns: impulse of each push, as in PencilTrial.
            delay_ms: delay from a decision to its force, as in PencilTrial.
            max_s: length of an episode; None: no limit.
            threads: threads that trace light.
            meter: measures the stages of a tick.
        """
        self.push_mns = push_mns
        self._length_m = length_m
        super().__init__(
            pencil_model(length_m),
            CAMERAS,
            sensor=sensor_of(fps),
            threads=threads,
            meter=meter,
            limits=dict.fromkeys(("tilt_x", "tilt_y"), (-FALLEN_RAD, FALLEN_RAD)),
            max_s=max_s,
            delays=DelayConfig(control_us=round(1000 * delay_ms)),
        )
        self._body = int(self.world.model.body("pencil").id)

    def _draw_start(self, random: np.random.Generator) -> Callable[[MjData], None]:
        place, tilt = random.uniform(-0.02, 0.02, 2), random.uniform(-0.05, 0.05, 2)

        def drawn(data: MjData) -> None:
            data.qpos[:] = np.concatenate([place, tilt])

        return drawn

    def _tick(self) -> bool:
        random, force = PUSHES.random(self.world.tick, self.world.seed), np.zeros(2)
        if random is not None:
            angle = random.uniform(0.0, 2.0 * np.pi)
            newton = push_ns(self.push_mns, self._length_m) / PUSHES.seconds
            force[:] = newton * np.cos(angle), newton * np.sin(angle)
        # in the middle of the stick
        self.world.data.xfrc_applied[self._body, :2] = force
        return super()._tick()


@dataclass(frozen=True)
class PencilTrial:
    """Settings of one trial: stick, pushes, delay."""

    length_m: float = LENGTH_M
    push_mns: float = 1.0
    """impulse of each push, one a second, mN s, on 0.2 m; other lengths lean as much (push_ns)"""
    delay_ms: float = 0.0
    """delay from a decision to its force, rounded up to whole ticks"""
    seconds: float = 3.0
    seed: int = 0
    """start, directions of pushes, the cameras' noise"""


@dataclass(frozen=True)
class PencilResult:
    """The result of a trial."""

    stood_s: float
    fallen: bool
    sway_mm: float
    """root mean square of the cart's way from the middle"""


Watch = Callable[[Observation, Controller], None]
"""called after each tick of a trial"""


class PencilExperiment:
    """The loop with one tracker, stick length and delay, for any number of trials."""

    def __init__(self, tracker: str, length_m: float = LENGTH_M, delay_ms: float = 0.0) -> None:
        """Build the scene.

        Args:
            tracker: one of TRACKERS.
            length_m: of the stick.
            delay_ms: delay from a decision to its force.

        Raises:
            EvsError: there is no such tracker.
        """
        if tracker not in TRACKERS:
            raise unknown("tracker", tracker, TRACKERS)
        self.fps, self.length_m, self.delay_ms = TRACKERS[tracker], length_m, delay_ms
        self.loop = PencilLoop(self.fps, length_m, delay_ms=delay_ms)

    def play(
        self, trial: PencilTrial, gains: StickGains | None = None, watch: Watch | None = None
    ) -> PencilResult:
        """Run one trial, until the stick has fallen or the time is over.

        Args:
            trial: its settings, with the length and the delay of this experiment.
            gains: of the controller.
            watch: called after each tick.

        Raises:
            EvsError: the trial has another length or delay.
        """
        if (trial.length_m, trial.delay_ms) != (self.length_m, self.delay_ms):
            raise EvsError(f"{trial} in an arena for {self.length_m:g} m, {self.delay_ms:g} ms")
        controller = Controller(make_tracker(self.fps, self.length_m), self.length_m, gains)
        self.loop.push_mns = trial.push_mns
        observation = self.loop.reset(trial.seed)
        ticks, tick, way = max(1, round(trial.seconds * 1000)), 0, 0.0
        while tick < ticks and not observation.done:
            observation = self.loop.step(controller.decide(observation))
            tick += 1
            way += float(observation.position @ observation.position)
            if watch is not None:
                watch(observation, controller)
        return PencilResult(tick * 1e-3, bool(observation.done), 1e3 * float(np.sqrt(way / tick)))


def pencil_model(length_m: float = LENGTH_M) -> MjModel:
    """The scene with a stick of this length, cut from the same pencil.

    Raises:
        EvsError: the cameras do not see a stick of this length.
    """
    if not 0.005 <= length_m <= 0.22:
        raise EvsError(f"a stick of {length_m} m: the cameras see 0.005 ... 0.22 m")
    spec = load_spec(SCENE)
    share = length_m / LENGTH_M
    for geom in spec.body("pencil").geoms:
        geom.pos = np.array(geom.pos) * share
        geom.size = np.array(geom.size) * (1.0, share, 1.0)
        geom.mass = geom.mass * share
    return load_model(spec)


def push_ns(push_mns: float, length_m: float) -> float:
    """The impulse that makes a stick lean as much as push_mns makes one of 0.2 m lean, N s.

    A push J at the middle turns a stick at once at the rate 3 J / (2 m L), which amounts to a lean
    of that rate over w. m grows with L, and w falls with the root of L.
    """
    return float(push_mns * 1e-3 * (length_m / LENGTH_M) ** 1.5)
