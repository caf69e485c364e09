"""Keys that follow from the background at one or several light levels: laws of leak and noise."""

from __future__ import annotations

import math

from evs.emulator.sensor import SensorParameters
from evs_lab.fit.estimate import Estimate, cannot
from evs_lab.fit.photocurrent import photocurrent
from evs_lab.fit.still import Background

DARK_LUX = 0.0


def noise_share(base: SensorParameters, lux: float) -> float:
    """How much of the noise in the dark is left at this light, by the law of the base."""
    bright, dim = base.shot_noise_bright, base.dim_lux
    if base.shot_noise_law == "inverse":
        return bright + (1.0 - bright) * (dim / (dim + lux) if lux > 0.0 else 1.0)
    relative = (lux + dim) / (base.bright_lux + dim)
    return 1.0 - (1.0 - bright) * min(1.0, relative)


def law_estimates(
    found: list[Background], base: SensorParameters, thresholds: dict[str, Estimate]
) -> list[Estimate]:
    """Leak, its growth with the light, noise and its law, the spread, and the hot tail.

    Args:
        found: The background at each light level that was recorded.
        base: Gives the law and the light levels that the rates refer to. If it has photon noise,
            the noise tells its photocurrent.
        thresholds: What other recordings tell of the thresholds, by key.
    """
    levels = sorted(found, key=lambda one: one.lux)
    darkest = levels[0]
    estimates = _leak(levels, base)
    if base.photocurrent_pa > 0.0:
        estimates.append(photocurrent(darkest, base, thresholds))
    else:
        estimates += _noise(levels, base)
    for one in levels:
        for key, (value, error) in (
            ("noise_rate_cov_decades", one.spread),
            ("hot_leak_median_hz", one.tail_median),
            ("hot_leak_cov_decades", one.tail_spread),
        ):
            if key in one.reasons:
                estimates.append(cannot(key, one.source, one.reasons[key]))
            elif one is darkest or key == "noise_rate_cov_decades":
                estimates.append(Estimate(key, value, error, one.source).checked())
    return estimates


def _leak(levels: list[Background], base: SensorParameters) -> list[Estimate]:
    """leak + parasitic lux / bright_lux: with two levels both, with one their sum at it."""
    keys = "leak_rate_hz", "parasitic_leak_hz"
    seen = [one for one in levels if math.isfinite(one.leak[0])]
    if not seen:
        reason = levels[0].reasons.get(keys[0], "no leak shows")
        return [cannot(key, levels[0].source, reason) for key in keys]
    first, last = seen[0], seen[-1]
    share_first, share_last = (one.lux / base.bright_lux for one in (first, last))
    if share_last - share_first < 1e-3:
        light = cannot(keys[1], first.source, "one light level; record a still view in other light")
        value, error = first.leak
        # what the light adds by the base is taken off
        value -= base.parasitic_leak_hz * share_first
        error = math.hypot(error, 0.5 * base.parasitic_leak_hz * share_first)
        return [Estimate(keys[0], max(value, 0.0), error, first.source,
                         note=_with_tail(first)), light]  # fmt: skip
    slope = (last.leak[0] - first.leak[0]) / (share_last - share_first)
    slope_error = math.hypot(last.leak[1], first.leak[1]) / (share_last - share_first)
    value = first.leak[0] - slope * share_first
    error = math.hypot(first.leak[1], slope_error * share_first)
    source = f"{first.source}, {last.source}"
    parasitic = Estimate(keys[1], max(slope, 0.0), slope_error, source).checked()
    if slope < 2.0 * slope_error:
        parasitic = cannot(keys[1], source, f"leak grows by {slope:.2g} +- {slope_error:.2g} Hz")
    return [Estimate(keys[0], max(value, 0.0), error, source, note=_with_tail(first)), parasitic]


def _with_tail(one: Background) -> str:
    return "with its hot tail" if "hot_leak_median_hz" in one.reasons else ""


def _noise(levels: list[Background], base: SensorParameters) -> list[Estimate]:
    """The rate in the dark, and what is left of it in the brightest light."""
    keys = "shot_noise_rate_hz", "shot_noise_bright", "shot_noise_law"
    law = cannot(keys[2], levels[0].source, "three light levels tell a law; the base gives it")
    first, last = levels[0], levels[-1]
    share = noise_share(base, first.lux)
    note = "" if first.lux == DARK_LUX else f"from {first.lux:g} lux by the base's law"
    value, error = (part / share for part in first.noise)
    rate = Estimate(keys[0], value, error, first.source, note=note)
    if keys[0] in first.reasons:
        rate = cannot(keys[0], first.source, first.reasons[keys[0]])
        return [rate, cannot(keys[1], first.source, "no noise shows in the dark"), law]
    if len(levels) < 2 or first.lux != DARK_LUX or last.lux < base.bright_lux * 0.1:
        reason = "it takes a lens cap and a still view in bright light"
        return [rate, cannot(keys[1], last.source, reason), law]
    # share(lux) is linear in what is left at most
    dark, none = _left(base, last.lux)
    ratio = last.noise[0] / first.noise[0]
    error = math.hypot(last.noise[1], ratio * first.noise[1]) / first.noise[0]
    bright = (ratio - none) / (dark - none)
    bright_error = error / (dark - none)
    return [rate, Estimate(keys[1], min(max(bright, 0.0), 1.0), bright_error,
                           f"{first.source}, {last.source}"), law]  # fmt: skip


def _left(base: SensorParameters, lux: float) -> tuple[float, float]:
    """noise_share at this light, if all or nothing of the noise were left in bright light."""
    from dataclasses import replace

    return (
        noise_share(replace(base, shot_noise_bright=1.0), lux),
        noise_share(replace(base, shot_noise_bright=0.0), lux),
    )
