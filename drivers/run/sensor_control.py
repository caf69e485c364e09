"""Parameters of a run's sensors that clients of its sinks may read and change while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Protocol, runtime_checkable

from evs.emulator.config import RunConfig
from evs.emulator.config.declaration import declaration
from evs.emulator.sensor import SensorParameters, describe_sensor
from evs.msgs import EvsError, unknown

MOST_CHANGES = 10_000
"""changes that the report lists; the newest takes the place of the last"""

_FROM_ZERO = ("sigma_thres", "highpass_hz")
"""parameters that may be 0 and change"""


@runtime_checkable
class AdjustableCamera(Protocol):
    """A camera whose sensor may change while it runs; evs.emulator's Camera is one."""

    @property
    def name(self) -> str:
        """Its name on the bus and in recordings."""

    @property
    def sensor(self) -> SensorParameters:
        """The present sensor, resolved."""

    @property
    def config(self) -> RunConfig:
        """What it is made from; [sensor] is as it is now."""

    @property
    def adjustable(self) -> tuple[str, ...]:
        """Keys that `adjust` takes."""

    def adjust(self, **keys: object) -> None:
        """Change parameters from the next tick on. EvsError: nothing has changed."""


class TimedCameras(Protocol):
    """What a control needs of a world."""

    @property
    def cameras(self) -> Sequence[object]:
        """All of them."""

    @property
    def t_us(self) -> int:
        """Simulated time, us."""


class SensorControl:
    """The sensors of a run. The thread that steps the world uses it, between two ticks."""

    def __init__(self, world: TimedCameras) -> None:
        """Make the control of the cameras of a world."""
        self._world = world
        self.changes: list[dict[str, Any]] = []
        """of every change: t_us, from which time on, camera, and values"""
        self._initial: dict[tuple[str, str], float] = {}
        """(camera, key) -> the first value that was described"""

    def parameters(self) -> dict[str, list[dict[str, Any]]]:
        """Describe what may change.

        Returns:
            For each camera, by its name: key, value, initial (with which the run began), lowest,
            highest, unit, text of each parameter; biases have integers. Empty for a camera that
            takes no changes.
        """
        found = {
            one.name: [*_parameters(one), *_biases(one)]
            for one in self._world.cameras
            if isinstance(one, AdjustableCamera)
        }
        for camera, described in found.items():
            for about in described:
                key = camera, about["key"]
                about["initial"] = self._initial.setdefault(key, about["value"])
        return found

    def set(self, camera: str, values: Mapping[str, object]) -> None:
        """Change parameters of a camera from the next tick on.

        Args:
            camera: Its name; empty: the only one.
            values: Key, as in `parameters`, and value.

        Raises:
            EvsError: No such camera or key, or an impossible value; nothing has changed.
        """
        # what the run began with is described before it changes
        self.parameters()
        found = {one.name: one for one in self._world.cameras if isinstance(one, AdjustableCamera)}
        if not found:
            raise EvsError("no sensor of this run changes while it runs")
        if not camera and len(found) == 1:
            camera = next(iter(found))
        if camera not in found:
            raise unknown("camera", camera, found)
        for key in values:
            if key not in found[camera].adjustable:
                raise unknown("parameter that changes", key, found[camera].adjustable)
        found[camera].adjust(**values)
        change = {"t_us": self._world.t_us, "camera": camera, "values": dict(values)}
        if len(self.changes) == MOST_CHANGES:
            self.changes.pop()
        self.changes.append(change)


def _parameters(camera: AdjustableCamera) -> list[dict[str, Any]]:
    declared = {each.name: declaration(each) for each in fields(SensorParameters)}
    found = []
    for key in camera.adjustable:
        about, value = declared.get(key), getattr(camera.sensor, key, None)
        if about is None or about.within is None or not (value or key in _FROM_ZERO):
            continue
        lowest, highest = about.within
        limits = {"lowest": float(lowest), "highest": float(highest)}
        found.append({"key": key, "value": value, **limits, "unit": about.unit, "text": about.doc})
    return found


def _biases(camera: AdjustableCamera) -> list[dict[str, Any]]:
    return [
        {
            "key": f"biases.{bias.key}",
            "value": bias.value,
            "lowest": bias.lowest,
            "highest": bias.highest,
            "unit": "",
            "text": f"bias of the chip, {bias.nominal} in the preset",
        }
        for bias in describe_sensor(camera.config.sensor).biases
    ]
