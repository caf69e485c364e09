"""NamedSensors: readings of the model's sensors, for code that may see into the simulator.

Rewards and tests may. A controller may not: it has events and its actuators' encoders.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import mujoco

from evs.emulator.base.scene import F64
from evs.emulator.world.encoders import Encoders
from evs.msgs import unknown


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


class NamedSensors:
    """Some <sensor>s of a model by their names."""

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
