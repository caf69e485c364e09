"""What a robot measures of itself at one instant: its encoders, and MuJoCo's sensors by name.

After mj_step the live data's actuator lengths and sensors belong to the step's beginning. So the
state is copied into a private mjData, and as much as is needed is computed again there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.world.model import find, new_data
from evs.emulator.world.physics import STATE, update_poses
from evs.msgs import EvsError, unknown

Stages = mujoco.mjtStage
Kinds = mujoco.mjtSensor

_NEEDS_ALL = {
    int(kind)
    for kind in (
        Kinds.mjSENS_E_KINETIC,
        Kinds.mjSENS_JOINTLIMITPOS,
        Kinds.mjSENS_JOINTLIMITVEL,
        Kinds.mjSENS_TENDONLIMITPOS,
        Kinds.mjSENS_TENDONLIMITVEL,
        Kinds.mjSENS_USER,
        Kinds.mjSENS_PLUGIN,
    )
}
"""Kinds that read inertias, constraints or who knows what, earlier though their stage is."""


@dataclass(frozen=True)
class Limit:
    """The range that a sensor of the model has to stay in."""

    name: str
    low: float
    high: float
    begin: int
    """its first place in sensordata"""
    end: int
    stage: int
    """how much of the forward dynamics it needs, a mjtStage"""

    def keeps(self, sensordata: F64) -> bool:
        """Whether the readings (nsensordata,) of a moment are inside; a NaN is not."""
        values = sensordata[self.begin : self.end]
        return bool(((values >= self.low) & (values <= self.high)).all())

    def __str__(self) -> str:
        """As the reason of an end."""
        return f"{self.name} left {self.low:g} ... {self.high:g}"


class Encoders:
    """Encoders of the actuators, and sensors with limits, of one model."""

    def __init__(self, model: mujoco.MjModel, limits: Mapping[str, Any] | None = None) -> None:
        """Make a private mjData.

        Args:
            model: The model.
            limits: Name of a sensor -> (low, high).

        Raises:
            EvsError: No such sensor, or no range.
        """
        self._model = model
        self._data = new_data(model)
        self._state = np.zeros(mujoco.mj_stateSize(model, STATE))
        self.limits = read_limits(model, limits or {})
        self._stage = max((limit.stage for limit in self.limits), default=0)

    def read(self, data: mujoco.MjData, model: mujoco.MjModel | None = None) -> None:
        """Measure a state.

        Args:
            data: It; only read.
            model: A copy of the model with other values, which the data is of; None: the model.
        """
        model, own = model or self._model, self._data
        mujoco.mj_getState(model, data, self._state, STATE)
        mujoco.mj_setState(model, own, self._state, STATE)
        if self._stage >= int(Stages.mjSTAGE_ACC):
            mujoco.mj_forward(model, own)
            return
        update_poses(model, own)
        mujoco.mj_tendon(model, own)
        mujoco.mj_transmission(model, own)
        mujoco.mj_fwdVelocity(model, own)
        if self._stage >= int(Stages.mjSTAGE_POS):
            mujoco.mj_sensorPos(model, own)
        if self._stage >= int(Stages.mjSTAGE_VEL):
            mujoco.mj_sensorVel(model, own)

    @property
    def stage(self) -> int:
        """How much of the forward dynamics the sensors need, a mjtStage; 0: there are none."""
        return self._stage

    @property
    def sensordata(self) -> F64:
        """(nsensordata,) all readings, a copy; true are those of sensors with limits."""
        return np.array(self._data.sensordata, np.float64)

    @property
    def position(self) -> F64:
        """(n,) length of each actuator's transmission, a copy: rad, m, or what its gear makes."""
        return np.array(self._data.actuator_length, np.float64)

    @property
    def velocity(self) -> F64:
        """(n,) its change, 1/s of that, a copy."""
        return np.array(self._data.actuator_velocity, np.float64)

    @property
    def values(self) -> dict[str, F64]:
        """Readings of each sensor with limits, (its dimension,) float64, copies."""
        return {
            limit.name: np.array(self._data.sensordata[limit.begin : limit.end], np.float64)
            for limit in self.limits
        }

    def left(self) -> str:
        """The first limit that a sensor is not within, as a reason; "": all are kept.

        The ends of a range belong to it; a NaN is outside.
        """
        for limit in self.limits:
            if not limit.keeps(self._data.sensordata):
                return str(limit)
        return ""


def read_limits(model: mujoco.MjModel, limits: Mapping[str, Any]) -> tuple[Limit, ...]:
    """Limits by the names of sensors. Raises EvsError where one does not exist or is no range."""
    return tuple(_limit(model, name, value) for name, value in limits.items())


def _limit(model: mujoco.MjModel, name: str, value: Any) -> Limit:
    index = find(model, mujoco.mjtObj.mjOBJ_SENSOR, "sensor", str(name))
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        low = high = math.nan
    if not low < high:
        raise EvsError(f"limits['{name}'] is {value!r}; give (low, high), for example (-0.5, 0.5)")
    begin = int(model.sensor_adr[index])
    needs_all = int(model.sensor_type[index]) in _NEEDS_ALL
    stage = int(Stages.mjSTAGE_ACC if needs_all else model.sensor_needstage[index])
    return Limit(str(name), low, high, begin, begin + int(model.sensor_dim[index]), stage)


def add_joint_sensors(spec: mujoco.MjSpec, joints: Mapping[str, str]) -> None:
    """Give a robot joint sensors, which change nothing of how it moves.

    Limits, rewards and claims go by names of sensors.

    Args:
        spec: The robot, changed in place.
        joints: Name of a new <jointpos> -> its joint.

    Raises:
        EvsError: No such joint.
    """
    for name, joint in joints.items():
        if spec.joint(joint) is None:
            raise unknown("joint", joint, (one.name for one in spec.joints if one.name))
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint,
        )


class Measurements:
    """What many worlds of one model measure, each at its last instant.

    A world ends where a sensor leaves its limits.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        worlds: int,
        limits: Mapping[str, Any] | None,
        sensors: Iterable[str],
    ) -> None:
        """Make room for them.

        Args:
            model: The model.
            worlds: How many.
            limits: Name of a sensor -> (low, high).
            sensors: Names of others that are read.

        Raises:
            EvsError: No such sensor, or no range.
        """
        self._limits = read_limits(model, limits or {})
        free = dict.fromkeys(sensors, (-math.inf, math.inf))
        self._read = read_limits(model, free)
        # reads the state of any world
        self._one = Encoders(model, {**free, **(limits or {})})
        self.stage = max(self._one.stage, int(Stages.mjSTAGE_VEL))
        """how much of the forward dynamics they need, a mjtStage"""
        self.position = np.zeros((worlds, len(self._one.position)))
        """(n, actuators) as in Encoders"""
        self.velocity = np.zeros_like(self.position)
        """(n, actuators) as in Encoders"""
        self.sensordata = np.zeros((worlds, model.nsensordata))
        """(n, nsensordata)"""

    def measure(self, world: int, data: mujoco.MjData, model: mujoco.MjModel) -> None:
        """Measure a world.

        Args:
            world: Its number.
            data: Its data; only read.
            model: Its model.
        """
        self._one.read(data, model)
        self.position[world], self.velocity[world] = self._one.position, self._one.velocity
        self.sensordata[world] = self._one.sensordata

    def rows(self, worlds: list[int]) -> list[F64]:
        """What some worlds have measured, for `put_rows`."""
        return [rows[worlds] for rows in (self.position, self.velocity, self.sensordata)]

    def put_rows(self, worlds: list[int], before: list[F64]) -> None:
        """These worlds have measured what they had when `rows` gave it."""
        for rows, own in zip((self.position, self.velocity, self.sensordata), before, strict=True):
            rows[worlds] = own

    def left(self, which: Iterable[int]) -> dict[int, str]:
        """The first limit that each of these worlds has left, where one has, as a reason."""
        found: dict[int, str] = {}
        for limit in self._limits:
            values = self.sensordata[:, limit.begin : limit.end]
            if not ((values >= limit.low) & (values <= limit.high)).all():
                for world in which:
                    if world not in found and not limit.keeps(self.sensordata[world]):
                        found[world] = str(limit)
        return found

    @property
    def readings(self) -> dict[str, F64]:
        """Readings of the named sensors: name -> (n, dimension) float64, copies."""
        return {one.name: self.sensordata[:, one.begin : one.end].copy() for one in self._read}


class NamedSensors:
    """Readings of the model's <sensor>s by name, for code that may look into the simulator.

    Rewards and tests may. A controller may not: it has events and its actuators' encoders.
    """

    def __init__(self, model: mujoco.MjModel, names: Iterable[str] | None = None) -> None:
        """Find the sensors.

        Args:
            model: The model.
            names: Of sensors; None: every one that has a name.

        Raises:
            EvsError: No such sensor.
        """
        if names is None:
            kind = mujoco.mjtObj.mjOBJ_SENSOR
            named = (mujoco.mj_id2name(model, kind, index) for index in range(model.nsensor))
            names = [name for name in named if name]
        self._encoders = Encoders(model, dict.fromkeys(names, (-math.inf, math.inf)))

    def read(self, data: mujoco.MjData) -> dict[str, F64]:
        """Name -> (its dimension,) float64, of this very instant. `data` is only read."""
        self._encoders.read(data)
        return self._encoders.values

    @property
    def names(self) -> tuple[str, ...]:
        """In the order requested; of all, in the model's."""
        return tuple(limit.name for limit in self._encoders.limits)
