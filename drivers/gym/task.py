"""Task: all of an environment but its worlds, for one of them or many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.environments.episode import EpisodeSpec
from evs.drivers.gym.library import spaces
from evs.emulator.config import SensorConfig
from evs.emulator.config.decoding import plain_integer
from evs.emulator.config.keywords import named_keywords
from evs.emulator.simulation.scene_ranges import check_start
from evs.emulator.simulation.stacked_arrays import FULL, StackedArrays
from evs.emulator.world import MjModel, NamedSensors, actuator_names, control_range
from evs.msgs import EvsError, unknown

F64 = npt.NDArray[np.float64]


class Actions:
    """Box (nu,) float32 of -1 ... 1, scaled to each actuator's control range."""

    def __init__(
        self,
        names: Sequence[str],
        limits: F64,
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Find the range of each actuator.

        Args:
            names: Names of the actuators.
            limits: (nu, 2) control ranges of the model.
            ranges: Name of an actuator -> (low, high), which replaces the model's.

        Raises:
            EvsError: An actuator has no range or does not exist, or there are none.
        """
        if not names:
            raise EvsError("the scene has no actuators, so there is nothing to control: add some")
        given = dict(ranges or {})
        for name in given:
            if name not in names:
                raise unknown("actuator", str(name), names)
        pairs = [
            _range(name, given.get(name, limit)) for name, limit in zip(names, limits, strict=True)
        ]
        low, high = np.array(pairs, np.float64).T
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self.space = spaces.Box(-1.0, 1.0, (len(names),), np.float32)

    def control(self, action: npt.ArrayLike) -> F64:
        """Convert an action to controls.

        Args:
            action: (nu,) numbers, clipped to -1 ... 1, or (n, nu) of many.

        Returns:
            Float64 controls of that shape.

        Raises:
            EvsError: The action has another shape.
        """
        values = np.asarray(action, np.float64)
        if values.ndim not in (1, 2) or values.shape[-1:] != self._middle.shape:
            raise EvsError(
                f"the action has shape {values.shape}, not {self._middle.shape}: "
                "give one number for each actuator"
            )
        return np.asarray(self._middle + self._half * np.clip(values, -1.0, 1.0), np.float64)


def _range(name: str, value: Sequence[float] | F64) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        raise EvsError(f"the range of actuator '{name}' is {value!r}; give (low, high)") from None
    if np.isinf(low) or np.isinf(high):
        raise EvsError(
            f"actuator '{name}' has no ctrlrange: give it one in the model, or "
            f"control_range={{'{name}': (-1, 1)}}"
        )
    if not low < high:
        raise EvsError(f"the range of actuator '{name}' is {low:g} ... {high:g}: swap its ends")
    return low, high


Sensors = dict[str, npt.NDArray[np.float64]]
"""name of a <sensor> of the model -> its values"""

Reward = Mapping[str, float] | Callable[[Sensors, npt.NDArray[np.float64]], float]
"""name of a <sensor> -> weight of its length (absolute value, of one number); or a function of all
named sensors and the control."""

NO_BOUND = float(np.finfo(np.float32).max)
"""encoders have no bound"""


@contextmanager
def random_unchanged_on_error(*generators: np.random.Generator | None) -> Iterator[None]:
    """Let generators draw the same numbers again if the block raises."""
    states = [(one, one.bit_generator.state) for one in generators if one is not None]
    try:
        yield
    except BaseException:
        for one, state in states:
            one.bit_generator.state = state
        raise


@named_keywords
@dataclass(frozen=True, eq=False)
class TaskSpec(EpisodeSpec):
    """Episodes of an agent: its observations, its rewards and the length.

    LoopEnv, LoopVectorEnv, `gymnasium.make` and evs.make_vec take these fields as keywords, or a
    value in place of the scene.
    """

    sensor: str | SensorConfig = "ideal"
    """preset or SensorConfig"""
    ticks: int = 10
    """how many a step takes"""
    size: tuple[int, int] | None = (64, 64)
    """(width, height) of the sensor, px, unless its SensorConfig states one; None: its own"""
    observation: str = "event_frame"
    """event_frame | voxel_grid | time_surface | packet"""
    encoders: bool = False
    """the actuators' encoders too; observations then are a Dict"""
    max_s: float = 5.0
    """simulated seconds after which an episode is truncated"""
    reward: Reward | None = None
    """name of a <sensor> -> weight of its length; or f(sensors, control) -> float"""
    alive: float = 1.0
    """added for each step that did not terminate the episode"""
    control_range: Mapping[str, tuple[float, float]] | None = None
    """name of an actuator -> (low, high), instead of its ctrlrange"""

    @property
    def sized_sensor(self) -> SensorConfig:
        """The sensor with this size. Raises EvsError."""
        return sized(self.sensor, self.size)


def observation_space(arrays: StackedArrays) -> spaces.Box:
    """The space of a camera's observation, a row of these arrays."""
    shape = arrays.array.shape[1:]
    if arrays.kind == "packet":
        width, height = arrays.size
        oldest = np.iinfo(np.int32).min
        low = np.tile(np.array([oldest, 0, 0, -1], np.int32), (shape[0], 1))
        high = np.tile(np.array([0, width - 1, height - 1, 1], np.int32), (shape[0], 1))
        return spaces.Box(low, high, dtype=np.int32)
    ends = {"event_frame": (0, FULL), "voxel_grid": (-FULL, FULL)}.get(arrays.kind, (0, 1))
    return spaces.Box(*ends, shape, arrays.array.dtype.type)


class Task:
    """What an agent does, observes and is rewarded for, and how long."""

    def __init__(
        self,
        spec: TaskSpec,
        model: MjModel,
        cameras: Mapping[str, StackedArrays],
        tick_us: int,
    ) -> None:
        """Check everything.

        Args:
            spec: The fields of an environment.
            model: The model.
            cameras: Name of a camera -> the arrays of its observations.
            tick_us: Length of a tick, us.

        Raises:
            EvsError: A field is not possible; the message is one line.
        """
        self.ticks, self._tick_us = _whole_ticks(spec.ticks), tick_us
        self.max_us = _microseconds(spec.max_s)
        known = NamedSensors(model).names
        self._reward = _checked_reward(spec.reward or {}, known)
        self.sensors = known if callable(self._reward) else tuple(self._reward)
        """the <sensor>s whose readings the reward needs"""
        if not isinstance(spec.alive, int | float):
            raise EvsError(f"alive is {spec.alive!r}; give what a step adds, a number")
        self._alive = float(spec.alive)
        self.start = check_start(model, spec.start or {})
        names, ranges = actuator_names(model), control_range(model)
        self._actions = Actions(names, ranges, spec.control_range)
        self.action_space = self._actions.space
        self._encoders = spec.encoders
        self._cameras = tuple(cameras)
        found = {name: observation_space(arrays) for name, arrays in cameras.items()}
        self.observation_space = self._space(found, int(model.nu))

    def _space(self, cameras: Mapping[str, spaces.Box], nu: int) -> spaces.Space[Any]:
        keys = dict(zip(self._keys(), cameras.values(), strict=True))
        if len(keys) == 1 and not self._encoders:
            return next(iter(cameras.values()))
        found: dict[str, spaces.Space[Any]] = dict(keys)
        if self._encoders:
            for name in ("position", "velocity"):
                if name in found:
                    raise EvsError(f"a camera is called '{name}', as the encoders are: rename it")
                found[name] = spaces.Box(-NO_BOUND, NO_BOUND, (nu,), np.float32)
        return spaces.Dict(found)

    def _keys(self) -> list[str]:
        """Keys of the cameras in a Dict: "events" for a single one, else their names."""
        return ["events"] if len(self._cameras) == 1 else list(self._cameras)

    @property
    def metadata(self) -> dict[str, Any]:
        """What depends on it of an environment's metadata."""
        return {"render_fps": 1e6 / (self.ticks * self._tick_us)}

    @property
    def measures(self) -> bool:
        """Whether readings of sensors or encoders are needed."""
        return bool(self.sensors) or self._encoders

    def control(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Controls of an action (nu,), or of many (n, nu). EvsError: it has another shape."""
        return self._actions.control(action)

    def ticks_left(self, t_us: int) -> int:
        """How many ticks the step takes that begins at t_us: fewer where the time is over."""
        return min(self.ticks, -(-(self.max_us - t_us) // self._tick_us))

    def worth(self, readings: Sensors, control: npt.NDArray[np.float64], terminated: bool) -> float:
        """The reward of a step.

        Args:
            readings: Of `sensors`, at its end.
            control: (nu,) in it.
            terminated: Whether it ended the episode.
        """
        worth = _reward_of(self._reward, readings, control)
        return worth + (0.0 if terminated else self._alive)

    def observation(
        self,
        events: Iterable[npt.NDArray[Any]],
        position: npt.NDArray[np.float64] | None,
        velocity: npt.NDArray[np.float64] | None,
    ) -> Any:
        """What the agent is given.

        Args:
            events: The array of each camera.
            position: Of the encoders, if they are wanted.
            velocity: Of the encoders, if they are wanted.
        """
        found = dict(zip(self._keys(), events, strict=True))
        if self._encoders and position is not None and velocity is not None:
            found["position"] = position.astype(np.float32)
            found["velocity"] = velocity.astype(np.float32)
        elif len(found) == 1:
            return found["events"]
        return found


def sized(sensor: str | SensorConfig, size: tuple[int, int] | None) -> SensorConfig:
    """The sensor with this size, unless its SensorConfig states one."""
    found = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
    if size is None or not isinstance(found, SensorConfig) or found.width or found.height:
        return found
    try:
        width, height = size
    except (TypeError, ValueError):
        raise EvsError(f"size is {size!r}: give (width, height) in px, or None") from None
    return replace(found, width=width, height=height)


def _checked_reward(reward: Reward, sensors: tuple[str, ...]) -> Reward:
    """Return a reward that is possible.

    Raises:
        EvsError: A sensor does not exist, or a weight is not a finite number.
    """
    if callable(reward):
        return reward
    if not isinstance(reward, Mapping):
        raise EvsError(f"reward is {reward!r}; give {{sensor: weight}}, or a function")
    for name, weight in reward.items():
        if name not in sensors:
            raise unknown("sensor", str(name), sensors)
        if not (isinstance(weight, int | float | np.number) and math.isfinite(weight)):
            raise EvsError(f"reward['{name}'] is {weight!r}; give its weight, a number")
    return reward


def _reward_of(reward: Reward, sensors: Sensors, control: npt.NDArray[np.float64]) -> float:
    """Return the reward of a step, without the bonus for being alive."""
    if callable(reward):
        return float(reward(sensors, control))
    return float(sum(weight * np.linalg.norm(sensors[name]) for name, weight in reward.items()))


def _whole_ticks(ticks: int) -> int:
    if plain_integer(ticks, "ticks") < 1:
        raise EvsError(f"ticks is {ticks}: a step is one tick or more")
    return int(ticks)


def _microseconds(max_s: float) -> int:
    if not (max_s > 0.0 and math.isfinite(max_s)):
        raise EvsError(f"max_s is {max_s}: give simulated seconds over 0, for example 5.0")
    return round(max_s * 1e6)
