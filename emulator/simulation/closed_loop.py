"""ClosedLoop: a world that moves only when a controller has decided."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.protocols import Commit, Meter
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.base.scene import F64
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SceneConfig, SensorConfig
from evs.emulator.config.decoding import plain_integer, plain_number
from evs.emulator.config.schema import DelayConfig
from evs.emulator.simulation.delayed_links import DelayedLinks, check_delays
from evs.emulator.simulation.world import World, over_at_once, prepare_restore_worlds, reset_worlds
from evs.emulator.state import (
    Resumable,
    Saved,
    joined,
    number,
    numbers,
    part,
    whole,
    word,
    words,
)
from evs.emulator.world import (
    Encoders,
    MjData,
    Scene,
    UnstableError,
    Visual,
    actuator_names,
    check_control,
    control_range,
)
from evs.msgs import EventPacket, EvsError, Observation, StreamInfo


class ClosedLoop(Resumable):
    """A closed loop in lock-step: `step` takes a decision and returns the next observation.

        limits = {"tilt": (-0.5, 0.5)}
        loop = ClosedLoop("cart.xml", cameras=("left", "right"), limits=limits, max_s=30.0)
        seen = loop.reset(seed=1)
        while not seen.done:
            seen = loop.step(controller(seen))

    Packets hold whole ticks. The same seed and the same controls give the same bytes.
    """

    def __init__(
        self,
        scene: Scene | SceneConfig,
        cameras: str | CameraConfig | tuple[str | CameraConfig, ...] = ("",),
        *,
        tick_us: int = 1000,
        sensor: str | SensorConfig = "dvs128",
        render: RenderConfig | None = None,
        model: ModelConfig | None = None,
        seed: int = 0,
        threads: int = 0,
        limits: Mapping[str, tuple[float, float]] | None = None,
        max_s: float | None = None,
        delays: DelayConfig | None = None,
        meter: Meter | None = None,
        visual: Visual | None = None,
    ) -> None:
        """Make a world with these cameras, all of the same kind, and a loop around it.

        Args:
            scene: See `World`.
            cameras: Names of the model's cameras, or descriptions; "" is the first camera of the
                model, or a free camera if it has none.
            tick_us: Length of a tick, us.
            sensor: See `World.add_camera`. It applies to every camera.
            render: See `World.add_camera`.
            model: See `World.add_camera`.
            seed: Determines every random number.
            threads: Worker threads; 0: one per core.
            limits: Name of a sensor of the model -> (low, high); a reading outside ends the
                episode.
            max_s: Simulated seconds after which the episode ends; None: no limit.
            delays: Delays between cameras, controller and actuators; None: no delays.
            meter: Measures the time of each stage.
            visual: See `World`.

        Raises:
            EvsError: An argument makes no sense; one line.
        """
        world = World(
            scene, tick_us=tick_us, seed=seed, threads=threads, meter=meter, visual=visual
        )
        several = (cameras,) if isinstance(cameras, str | CameraConfig) else tuple(cameras)
        for camera in several:
            world.add_camera(camera, sensor=sensor, render=render, model=model)
        self._surround(world, limits, max_s, delays)

    @classmethod
    def around(
        cls,
        world: World,
        *,
        limits: Mapping[str, tuple[float, float]] | None = None,
        max_s: float | None = None,
        delays: DelayConfig | None = None,
    ) -> ClosedLoop:
        """Make a loop around a world with all its cameras; afterwards only the loop may step it.

        Until the first control is given, the world's own control source acts.

        Args:
            world: The world.
            limits: See the class.
            max_s: See the class.
            delays: See the class.

        Raises:
            EvsError: An argument makes no sense.
        """
        loop = cls.__new__(cls)
        loop._surround(world, limits, max_s, delays)
        return loop

    def _surround(
        self,
        world: World,
        limits: Mapping[str, tuple[float, float]] | None,
        max_s: float | None,
        delays: DelayConfig | None,
    ) -> None:
        if max_s is not None and not (max_s := plain_number(max_s, "max_s")) > 0.0:
            raise EvsError(f"max_s is {max_s:g}: give simulated seconds over 0, or None for no end")
        self.world = world
        self._encoders = Encoders(world.model, limits)
        self._max_s = max_s
        self._end_us = math.inf if max_s is None else max(1, round(max_s * 1e6))
        self._delays = check_delays(delays or DelayConfig())
        self._links = self._new_links(world.seed)
        self._wants_state = False
        self._done: str | None = None
        self.on_tick: Callable[[tuple[EventPacket, ...]], None] | None = None
        """called after every tick with its packets, before any delay: for recorders beside"""

    def __repr__(self) -> str:
        return f"<evs.ClosedLoop around {self.world!r}{f'; {self._done}' if self._done else ''}>"

    def _new_links(self, seed: int) -> DelayedLinks:
        for chunk in (camera.config.model.chunk for camera in self.world.cameras):
            if chunk > 1:
                raise EvsError(
                    f"model.chunk is {chunk}, but a decision needs the events of the tick before "
                    "it: leave it 1"
                )
        names = [camera.name for camera in self.world.cameras]
        return DelayedLinks(self._delays, names, self.nu, seed)

    def reset(
        self,
        seed: int | None = None,
        keyframe: str = "",
        state: bool = False,
        start: Callable[[MjData], None] | None = None,
        sensor: str | SensorConfig | None = None,
        scene: Mapping[str, float] | None = None,
        must_run: bool = False,
    ) -> Observation:
        """Begin an episode.

        Args:
            seed: All noise follows from it; None keeps the last one.
            keyframe: Name or number of the keyframe to start from; "" is the keyframe of the
                constructor.
            state: Whether observations of this episode contain the state of the physics.
            start: Puts the MjData into another state before the first observation.
            sensor: Another sensor for every camera; see `World.reset`. None keeps the last.
            scene: Values of the scene; see `World.reset`. None keeps the last.
            must_run: Whether a start outside the limits, where the episode is over at once, is an
                error.

        Returns:
            The observation before the first tick: the encoders, without events.

        Raises:
            EvsError: No such keyframe or key, invalid values, or an impossible sensor. Nothing has
                changed, even if `start` raised the error.
        """
        world = self.world
        reset = world.prepare_reset(seed, keyframe, sensor, scene)
        links = self._new_links(world.seed if seed is None else plain_integer(seed, "seed"))
        with unchanged_on_error(self), reset_worlds([world], [reset], [start]):
            self._links = links
            self._wants_state = bool(state)
            self._read_encoders()
            if must_run and self._done:
                raise over_at_once(self._done)
            return self._seen()

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        """Apply a decision and advance by some ticks, or fewer if the episode ends.

        Args:
            ctrl: (nu,) controls, which hold until the next ones take effect; None keeps the last.
            ticks: 1 or more.

        Returns:
            The observation at the end of these ticks.

        Raises:
            EvsError: The controls have a wrong shape or are not finite, ticks is below 1, there was
                no reset, or the episode is over. The world has not moved.
        """
        self._check_going()
        ticks = plain_integer(ticks, "ticks")
        if ticks < 1:
            raise EvsError(f"ticks is {ticks}: a step is one tick or more")
        if ctrl is not None:
            ctrl = check_control(ctrl, self.world.model.nu, "step(ctrl)")
            self._links.decide(ctrl, self.t_us)
        for _ in range(ticks):
            if not self._tick():
                break
        return self._seen()

    def _tick(self) -> bool:
        """Go on for one tick; whether the episode does."""
        world, links = self.world, self._links
        try:
            packets = world.step(links.acting(world.t_us))
        except UnstableError as reason:
            self._done = str(reason)
            self._encoders.read(world.data)
            return False
        if self.on_tick is not None:
            self.on_tick(packets)
        for place, (camera, packet) in enumerate(zip(world.cameras, packets, strict=True)):
            links.send(place, packet, world.t_us)
            for frame in camera.frames:
                links.send(place, frame, world.t_us)
            if camera.imu_packet is not None:
                links.send(place, camera.imu_packet, world.t_us)
        self._read_encoders()
        return not self._done

    def save(self, compress: bool = False) -> bytes:
        """See `Resumable.save`."""
        if self._done is None:
            raise EvsError("the loop has not begun: call reset before save")
        return super().save(compress)

    def restore(self, blob: bytes) -> Observation:
        """See `Resumable.restore`. No reset is required before.

        Returns:
            The observation at that time, with encoders and without packets, which `step` has
            already returned.
        """
        with self.world.values_of(blob):
            super().restore(blob)
        self._encoders.read(self.world.data)
        return self._seen()

    def prepare_restore(self, saved: Saved) -> Commit:
        """Check a saved state; the commit restores it. Raises EvsError."""
        done, wants_state = word(saved, "done"), bool(number(saved, "wants_state", 0, 1))
        world = part(saved, "world")
        links = self._like().read(part(saved, "channels"), whole(world, "seed"))
        commit_world = prepare_restore_worlds([self.world], [world])

        def commit() -> None:
            commit_world()
            self._links, self._done, self._wants_state = links, done, wants_state

        return commit

    @property
    def _knows_cameras(self) -> bool:
        return len(self.world.cameras) == len(self._links.cameras)

    def _like(self) -> DelayedLinks:
        """Links of the cameras of now: the world may have got another one since."""
        return self._links if self._knows_cameras else self._new_links(self.world.seed)

    def arrays(self) -> Saved:
        """What `save` packs, by name."""
        saved = joined(world=self.world.arrays(), channels=self._like().save())
        return saved | numbers(wants_state=self._wants_state) | words(done=self._done or "")

    @property
    def identity(self) -> dict[str, Any]:
        """Where a saved state belongs, in plain values."""
        limits = {
            limit.name: f"{limit.low:g} ... {limit.high:g}" for limit in self._encoders.limits
        }
        own = {"max_s": self._max_s, "limits": limits, "delays": asdict(self._delays)}
        return {**self.world.identity, "kind": "loop", "loop": own}

    def _check_going(self) -> None:
        if not self._knows_cameras:
            raise EvsError("the world has another camera since the last reset: call reset")
        if self._done is None:
            raise EvsError("the loop has not begun: call reset first")
        if self._done:
            raise EvsError(f"the episode is over ({self._done}): call reset")

    def _read_encoders(self) -> None:
        """Read the encoders and see whether the episode is over."""
        self._encoders.read(self.world.data)
        self._done = self._encoders.left()
        if not self._done and self.t_us - self.world.start_us >= self._end_us:
            self._done = f"{self._max_s:g} s are over"

    def _seen(self) -> Observation:
        return Observation(
            t_us=self.t_us,
            position=self._encoders.position,
            velocity=self._encoders.velocity,
            done=self._done or "",
            state=self.world.state if self._wants_state else None,
            **self._links.arrived(self.t_us),
        )

    @property
    def t_us(self) -> int:
        """Simulated time, us."""
        return self.world.t_us

    @property
    def tick_us(self) -> int:
        """Length of a tick, us."""
        return self.world.substeps.tick_us

    @property
    def nu(self) -> int:
        """Number of controls."""
        return int(self.world.model.nu)

    @property
    def dropped(self) -> dict[str, int]:
        """Packets, frames and IMU packets of each camera that were lost in this episode."""
        return self._links.dropped

    @property
    def events_dropped(self) -> int:
        """Events in the packets that were lost in this episode."""
        return self._links.events_dropped

    @property
    def done(self) -> str:
        """The reason why the episode ended; "" if it continues or has not begun."""
        return self._done or ""

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the controls. Raises EvsError."""
        return actuator_names(self.world.model)

    @property
    def ctrl(self) -> F64:
        """(nu,) the last decision, whether it has taken effect or not, a copy."""
        waiting = self._links.controls.waiting
        return np.array(waiting[-1].message if waiting else self.world.data.ctrl, np.float64)

    @property
    def ctrl_range(self) -> F64:
        """(nu, 2) lowest and highest control of each actuator; infinite without a limit."""
        return control_range(self.world.model)

    @property
    def streams(self) -> tuple[StreamInfo, ...]:
        """What is constant of each camera."""
        return tuple(camera.info for camera in self.world.cameras)
