"""A camera from several of its recordings: which recording tells what, and in which order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from evs.tools.fit.bandwidth import fit_bandwidth
from evs.tools.fit.estimate import Estimate, combined
from evs.tools.fit.frames import fit_frames
from evs.tools.fit.lamp import fit_lamp
from evs.tools.fit.laws import law_estimates, noise_share
from evs.tools.fit.observed import F64, Observed
from evs.tools.fit.period import find_period_s
from evs.tools.fit.ramp import check_light, fit_ramp
from evs.tools.fit.readout import fit_readout
from evs.tools.fit.refractory import fit_refractory
from evs.tools.fit.still import DECADE, Background, fit_still

ROOM_LUX = 100.0
"""of a recording whose light is not known"""


@dataclass(frozen=True)
class Light:
    """A recording and what is known of its light."""

    seen: Observed
    kind: str = "any"
    """dark: lens cap | still: no change | lamp: blinks | ramp: ln light is a triangle | any"""
    lux: float | None = None
    """illuminance of the sensor; of a lamp, while it is bright"""
    contrast: float | None = None
    """of lamp and ramp: brightest light over darkest"""
    period_s: float | None = None
    """of lamp and ramp; None: from the events"""


@dataclass(frozen=True)
class FittedCamera:
    """What the recordings of a camera tell."""

    base: SensorParameters
    lights: tuple[Light, ...]
    """with the periods that were found"""
    estimates: tuple[Estimate, ...] = field(default=())

    def __getitem__(self, key: str) -> Estimate:
        """The estimate of a key. KeyError: no recording was asked for it."""
        for one in self.estimates:
            if one.key == key:
                return one
        raise KeyError(key)

    @property
    def told(self) -> dict[str, Estimate]:
        """Key -> estimate, of the keys that the recordings tell."""
        return {one.key: one for one in self.estimates if one.told}


def fit_camera(lights: list[Light], base: SensorParameters) -> FittedCamera:
    """Fit a sensor to recordings of one camera.

    Args:
        lights: The recordings, all of one camera with one setting.
        base: The sensor that has the values which no recording tells, and the laws.

    Raises:
        EvsError: No recording, recordings of several sizes, or light that makes no sense.
    """
    if not lights:
        raise EvsError("nothing to fit: give a recording, --dark, --still, --lamp or --ramp")
    sizes = {(one.seen.width, one.seen.height) for one in lights}
    if len(sizes) > 1:
        named = ", ".join(
            f"{one.seen.source}: {one.seen.width} x {one.seen.height}" for one in lights
        )
        raise EvsError(f"the recordings are of several sizes ({named}); give those of one camera")
    lights = [_checked(one) for one in lights]
    still = [one for one in lights if one.kind in ("dark", "still")]
    changing = [one for one in lights if one.kind in ("ramp", "lamp")]

    # thresholds without the leak, which hardly matters for how uneven they are
    first = combined([e for one in changing for e in _thresholds(one, None, 0.0)])
    backgrounds = [fit_still(one.seen, one.lux or 0.0, _unevenness(first, base)) for one in still]
    leaks, leak_error_hz = _leaks(backgrounds, base)
    found: list[Estimate] = []
    for one in changing:
        found += _thresholds(one, leaks, leak_error_hz)
    noise_hz = max(
        (one.noise[0] for one in backgrounds),
        default=base.shot_noise_rate_hz * noise_share(base, ROOM_LUX),
    )
    for one in lights:
        if one.seen.frames:
            found += fit_frames(one.seen, noise_hz)
    if backgrounds:
        found += law_estimates(backgrounds, base)
    for one in changing:
        if one.kind == "lamp" and one.contrast and one.period_s:
            found += fit_bandwidth(one.seen, one.contrast, one.period_s, base, one.lux)
    for one in lights:
        found += [fit_refractory(one.seen), *fit_readout(one.seen)]
    return FittedCamera(base, tuple(lights), tuple(combined(found)))


def _checked(light: Light) -> Light:
    """The same, with its period."""
    if light.kind not in ("ramp", "lamp"):
        return light
    if light.contrast is None:
        raise EvsError(
            f"the contrast of {light.seen.source} is not known; give --contrast, the brightest "
            "light over the darkest"
        )
    period_s = find_period_s(light.seen) if light.period_s is None else light.period_s
    check_light(light.contrast, period_s)
    return Light(light.seen, light.kind, light.lux, light.contrast, period_s)


def _thresholds(light: Light, leaks: F64 | None, leak_error_hz: float) -> list[Estimate]:
    assert light.contrast is not None
    assert light.period_s is not None
    if light.kind == "lamp":
        return list(fit_lamp(light.seen, light.contrast, light.period_s))
    found = fit_ramp(light.seen, light.contrast, light.period_s, leaks, leak_error_hz)
    return list(found.estimates)


def _unevenness(found: list[Estimate], base: SensorParameters) -> float:
    values = {one.key: one.number for one in found if one.told}
    mean = values.get("pos_thres", base.pos_thres)
    return min(values.get("sigma_thres", base.sigma_thres) / mean, 0.5)


def _leaks(backgrounds: list[Background], base: SensorParameters) -> tuple[F64 | None, float]:
    """(leak of each pixel, error of their mean), Hz."""
    by_base = base.leak_rate_hz + base.parasitic_leak_hz * 0.3
    known = [one for one in backgrounds if math.isfinite(one.leak[0])]
    if not known:
        return None, max(by_base, 0.1)
    one = known[0]
    mean, error = one.leak
    if math.isfinite(one.tail_median[0]):
        sigma = min(one.tail_spread[0] * DECADE, 4.0)
        mean += one.tail_median[0] * math.exp(0.5 * sigma**2)
    # noise hides leak events, not the leak
    counted = float(np.mean(one.leak_hz))
    factor = min(max(mean / counted, 1.0), 3.0) if counted > 0.0 else 1.0
    return one.leak_hz * factor, math.hypot(error, 0.1 * mean * (factor - 1.0))
