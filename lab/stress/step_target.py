"""The step target: a black plate moves in front of a white one, so that the light is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import World
from evs.emulator.base.scene import F32, F64
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs.emulator.sensor.fixed_pattern import draw_pattern
from evs.msgs import Events
from evs_lab.stress.capture import IDEAL, Act, Capture, capture

MJCF = """<mujoco><visual><headlight active="0"/></visual><worldbody>
<light directional="true" castshadow="false" dir="0 1 0" diffuse="1 1 1" specular="0 0 0"/>
<camera name="eye" pos="0 -3 0" xyaxes="1 0 0 0 0 1" fovy="45"/>
<geom type="box" pos="0 1 0" size="90 .1 90" rgba="1 1 1 1"/>
<body mocap="true" pos="0 9 0"><geom type="box" size="20 .1 20" rgba="0 0 0 1"/></body>
</worldbody></mujoco>"""

OPEN, SHUT = np.inf, -20.0
"""x of the black plate's left edge, m: out of view, and covering the whole picture"""

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class StepCapture:
    """A capture of the step target."""

    capture: Capture
    sensor: SensorParameters
    first: F32
    """(h, w) luminance of the reference: the picture stood still for the first tick"""
    last: F32
    """(h, w) luminance at the end"""

    def counts(self, events: Events | None = None) -> tuple[I64, I64]:
        """Count the ON and OFF events of each pixel, (h, w): of all events, or of these."""
        shape = (self.sensor.height, self.sensor.width)
        events = self.capture.events if events is None else events
        pixel = events["y"].astype(np.int64) * shape[1] + events["x"]
        on, off = (
            np.bincount(pixel[events["p"] == p], minlength=shape[0] * shape[1]).reshape(shape)
            for p in (1, 0)
        )
        return on, off

    def residual_thresholds(self) -> float:
        """Largest contrast that the events of a pixel do not explain, in its own thresholds.

        Events explain the ON thresholds times ON events less the same of OFF. NaN if no pixel
        fired. Without a refractory period and filters it is below 1 by the definition of the
        pixel: at 1 there would be one more event.
        """
        on, off = self.counts()
        if not (on.any() or off.any()):
            return float("nan")
        theta_on, theta_off = self._thresholds
        change = log_of(self.last, self.sensor) - log_of(self.first, self.sensor)
        rest = change - (on * theta_on - off * theta_off)
        return float(np.where(rest > 0, rest / theta_on, -rest / theta_off).max() + 0.0)

    def rounding(self) -> float:
        """Largest error of two float32 logarithms, each within 2^-20, in thresholds."""
        return 2.0**-19 / self.least_threshold()

    def least_threshold(self) -> float:
        """Lowest threshold of all pixels and both polarities, log units."""
        return float(min(theta.min() for theta in self._thresholds))

    @cached_property
    def _thresholds(self) -> tuple[F64, F64]:
        pattern = draw_pattern(self.sensor, self.capture.world.cameras[0].info.seed)
        return pattern.on.astype(np.float64), pattern.off.astype(np.float64)


def log_of(luminance: F32, sensor: SensorParameters) -> F64:
    """L_log of the map `linlog` in float64."""
    dn = luminance.astype(np.float64) * sensor.exposure_dn + sensor.dark_dn
    knee = sensor.linlog_dn
    return np.where(dn >= knee, np.log(np.maximum(dn, knee)), np.log(knee) / knee * dn)


def capture_step(
    left: Callable[[int], float],
    ticks: int,
    tables: Mapping[str, Any] | None = None,
    mjcf: str = MJCF,
    watch: Act | None = None,
) -> StepCapture:
    """Move the black plate in front of the camera.

    Args:
        left: ticks done -> x of the plate's left edge, m, OPEN or SHUT. The plate covers everything
            to the right of it; the camera sees about 1.7 m to either side. `left(0)` holds until
            the end of the first tick: that light is the reference.
        ticks: how many.
        tables: of the pipeline.
        mjcf: text of the scene; the plate is its first mocap body.
        watch: called after each tick, before the plate moves.

    Raises:
        EvsError: as `capture` does.
    """
    config = {key: dict(value) if isinstance(value, Mapping) else value
              for key, value in (tables or {}).items()}  # fmt: skip
    render = {"spp": 1, **config.pop("render", {})}
    first: list[F32] = []

    def draw(tick: int, world: World) -> None:
        if tick == 1:
            first.append(world.cameras[0].luminance)
        if watch is not None and tick:
            watch(tick, world)
        edge = left(tick)
        world.data.mocap_pos[0] = (0, 9, 0) if edge == OPEN else (edge + 20, 0, 0)

    tick_us = config.get("scene", {}).get("tick_us", 1000)
    seen = capture(mjcf, ticks * tick_us * 1e-6, {**config, "render": render}, draw)
    camera = seen.world.cameras[0]
    sensor = resolve_sensor(SensorConfig(**{**IDEAL, **_sensor(config)}))
    return StepCapture(seen, sensor, first[0], camera.luminance)


def _sensor(tables: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in tables.get("sensor", {}).items() if not isinstance(v, Mapping)}


def edge_position(begin: int, length: int, tick: int) -> float:
    """Left edge of a plate that moves in at tick `begin` and out again, in `length` ticks each."""
    shut = min(tick - begin, begin + 2 * length - tick) / length
    return OPEN if shut <= 0 else 2.0 - 4.0 * shut


def capture_sweep(length: int, still: int, sensor: Mapping[str, Any]) -> StepCapture:
    """Move the plate in and out, `length` ticks each, then rest for `still`, with this [sensor]."""
    return capture_step(
        lambda tick: edge_position(1, length, tick), 1 + 2 * length + still, {"sensor": sensor}
    )


def messages_of(shown: StepCapture) -> tuple[str, ...]:
    """Warnings of a capture; without any, the event counts of its report."""
    report = shown.capture.report
    return shown.capture.warnings or (
        f"{report.events:,} events, {report.events_dropped:,} dropped",
    )
