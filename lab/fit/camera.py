"""A camera from several of its recordings: which recording tells what, and in which order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from evs_lab.fit.bandwidth import fit_bandwidth
from evs_lab.fit.estimate import Estimate, cannot, combined
from evs_lab.fit.frames import LEAK, fit_frames
from evs_lab.fit.lamp import fit_lamp
from evs_lab.fit.laws import law_estimates
from evs_lab.fit.observed import Mask, Observed
from evs_lab.fit.period import find_period_s
from evs_lab.fit.ramp import PixelLeaks, check_light, fit_ramp
from evs_lab.fit.readout import fit_readout
from evs_lab.fit.refractory import fit_refractory
from evs_lab.fit.still import DECADE, Background, fit_still

UNMEASURED = 0.15
"""mismatch over threshold that pixels may have"""


@dataclass(frozen=True)
class Light:
    """A recording and what is known of its light."""

    seen: Observed
    kind: str = "any"
    """dark: lens cap | still: no change | lamp: blinks | ramp: ln light is a triangle | any"""
    lux: float | None = None
    """illuminance of the sensor; of a lamp, while it is bright; of frames, in their white"""
    contrast: float | None = None
    """of lamp and ramp: brightest light over darkest"""
    period_s: float | None = None
    """of lamp and ramp; None: from the events"""
    dark_dn: float = 0.0
    """dark level of its frames, of white 255"""


@dataclass(frozen=True)
class FittedCamera:
    """What the recordings of a camera tell."""

    base: SensorParameters
    lights: tuple[Light, ...]
    """with the periods and dark levels that were found"""
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
    by_ramp = [one for one in changing if one.kind == "ramp"]
    blind = combined([_refractory(one) for one in lights])
    blind_s = _blind_s(blind[0], lights, base)
    by_lamp = [e for one in changing if one.kind == "lamp" for e in _by_lamp(one, blind_s)]
    first = combined(by_lamp + [e for one in by_ramp for e in _by_ramp(one, None, (0.0, 0.0))])
    uneven, alive = _unevenness(first, base), _alive(changing)
    backgrounds = [fit_still(one.seen, one.lux or 0.0, uneven, alive) for one in still]
    if not any(one.key == "sigma_thres" and one.told for one in first):
        backgrounds = [_as_uneven(one) for one in backgrounds]
    leaks = _leaks(backgrounds, base, lights[0].seen.pixels)
    found = list(by_lamp)
    for one in by_ramp:
        found += _by_ramp(one, leaks, blind_s)
    for place, one in enumerate(lights):
        if one.seen.frames:
            by_frames, dark_dn = fit_frames(one.seen, blind_s)
            lights[place] = replace(one, dark_dn=dark_dn)
            # views that stand tell leak and light apart
            found += [e for e in by_frames if not backgrounds or e.key != LEAK]
    if backgrounds:
        found += law_estimates(backgrounds, base, {one.key: one for one in combined(found)})
    for one in changing:
        if one.kind == "lamp" and one.contrast and one.period_s:
            found += fit_bandwidth(one.seen, one.contrast, one.period_s, base, one.lux, blind_s[0])
    found += blind
    for one in lights:
        found += fit_readout(one.seen)
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


def _by_lamp(light: Light, blind_s: tuple[float, float]) -> list[Estimate]:
    assert light.contrast is not None
    assert light.period_s is not None
    return list(fit_lamp(light.seen, light.contrast, light.period_s, blind_s))


def _by_ramp(
    light: Light, leaks: PixelLeaks | None, blind_s: tuple[float, float]
) -> list[Estimate]:
    assert light.contrast is not None
    assert light.period_s is not None
    return list(fit_ramp(light.seen, light.contrast, light.period_s, leaks, blind_s).estimates)


def _refractory(light: Light) -> Estimate:
    """The refractory period; events that the light brings have edges of their own."""
    found = fit_refractory(light.seen, still=light.kind in ("dark", "still"))
    if not found.told or light.kind in ("dark", "still"):
        return found
    shortest_us = int(light.seen.intervals.length_us.min())
    reason = f"it is at most {shortest_us} us; noise at constant light tells it"
    return cannot(found.key, found.source, reason)


def _blind_s(found: Estimate, lights: list[Light], base: SensorParameters) -> tuple[float, float]:
    """(refractory period, error); that of the base within the bound, if nothing tells it."""
    if found.told:
        return found.number, found.error
    lengths = [one.seen.intervals.length_us for one in lights]
    most_s = 1e-6 * min((int(each.min()) for each in lengths if len(each)), default=0)
    value = min(base.refractory_period_s, most_s)
    return value, 0.5 * value


def _unevenness(found: list[Estimate], base: SensorParameters) -> tuple[float, float]:
    values = {one.key: one.number for one in found if one.told}
    means = values.get("pos_thres", base.pos_thres), values.get("neg_thres", base.neg_thres)
    sigma = values.get("sigma_thres", base.sigma_thres)
    return min(sigma / means[0], 0.5), min(sigma / means[1], 0.5)


def _as_uneven(one: Background) -> Background:
    """The same with an error of the spread that mismatch which nobody measured may bring."""
    spread, error = one.spread
    own = UNMEASURED**2 / (2.0 * spread * DECADE**2) if spread > 0.0 else 0.0
    return replace(one, spread=(spread, math.hypot(error, own)))


def _alive(changing: list[Light]) -> Mask | None:
    """(pixels,) those that had events in changing light; None: no such recording."""
    if not changing:
        return None
    seen: Mask = np.any([o.seen.on_counts + o.seen.off_counts > 0 for o in changing], axis=0)
    return seen if seen.sum() >= 0.5 * len(seen) else None


def _leaks(backgrounds: list[Background], base: SensorParameters, pixels: int) -> PixelLeaks:
    """What the first still view that shows leak tells of it; else the base's."""
    by_base = base.leak_rate_hz + base.parasitic_leak_hz * 0.3
    known = [one for one in backgrounds if math.isfinite(one.leak[0]) and one.leak[0] > 0.0]
    if not known:
        return PixelLeaks(np.zeros(pixels), max(by_base, 0.1))
    one = known[0]
    counted, error = one.leak_hz, one.leak[1]
    # noise sets back the reference: of a leak L, N / (e^(N/L) - 1) is left in noise of a rate N
    usual_hz = max(float(np.mean(counted[counted <= np.quantile(counted, 0.95)])), 1e-9)
    seen = np.maximum(counted, usual_hz)
    noise = max(one.noise[0], 1e-9)
    gain = noise / np.log1p(noise / seen) / seen
    rates = counted * gain
    factor = float(gain.max())
    # chance in the counts, and how much the pixels really differ but for the hot ones
    chance = factor**2 * max(usual_hz + one.noise[0], 1e-9) / one.seconds
    usual = rates[rates <= np.quantile(rates, 0.95)]
    own = max(float(np.var(usual)) - chance, 0.0)
    if math.isfinite(one.spread[0]):
        own = max(own, one.leak[0] ** 2 * math.expm1((one.spread[0] * DECADE) ** 2))
    share = own / (own + chance)
    hot = rates > float(usual.mean()) + 6.0 * math.sqrt(own + chance)
    middle = float(rates[~hot].mean())
    shrunk = np.where(hot, rates, middle + share * (rates - middle))
    error = math.hypot(error, 0.1 * middle * (factor - 1.0))
    return PixelLeaks(shrunk, error, share * chance)
