"""The recordings again, with the fitted sensor in the camera's place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.config import SensorConfig
from evs.emulator.simulation.pixels import Pixels
from evs.msgs import EvsError
from evs_lab.fit.camera import Light
from evs_lab.fit.frames import FEWEST_PIXELS, WHITE, frame_light, standing
from evs_lab.fit.observed import Observed

STEPS = 16
"""frames of a rise, or of a fall; between them log light is straight"""

STILL_US = 100_000

WARM_S = 5.0
"""before a recording begins: what the pixels had done before it"""

MOST_S = 300.0
"""longest recording that is replayed"""

BLINK_US = (50, 1.3)
"""the first frame after a flank, and by what factor the next ones follow later"""

NOISY, FAR = 1.5, 6.0
"""deviation of a pixel in frames and its farthest frame, in deviations of the frames' noise"""

DIM_LUX = 100.0
"""of a lamp or a scene whose light is not known"""


def replayed(light: Light, sensor: str | SensorConfig, seed: int = 0) -> Observed | None:
    """The events of the sensor in this light, for as long as the recording.

    None: the light is not known, or the recording is longer than MOST_S.

    Args:
        light: A recording, of known light or with intensity frames.
        sensor: A sensor file, of the recording's size.
        seed: Of the sensor's noise and mismatch.
    """
    if light.seen.seconds > MOST_S or (light.kind == "any" and len(light.seen.frames) < 2):
        return None
    size = (light.seen.width, light.seen.height)
    config = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
    # events alone are compared
    config = replace(config, aps=replace(config.aps, enabled=False))
    pixels = Pixels(config, size=size, unit="lux", seed=seed)
    shape = size[::-1]
    parts = []
    theta = min(pixels.sensor.pos_thres, pixels.sensor.neg_thres)
    for lux, t_us, counts in _frames(light, theta):
        frame = np.broadcast_to(np.asarray(lux, np.float32), shape)
        events = pixels.observe(frame, t_us)
        if counts:
            parts.append(events)
    parts.append(pixels.finish())
    events = np.concatenate(parts)
    if len(events):
        # whole periods may be longer than the recording
        events = events[events["t"] <= events["t"][0] + round(1e6 * light.seen.seconds)]
    try:
        return Observed(events, *size, source=f"{sensor}")
    except EvsError:
        return None


def _frames(light: Light, theta: float) -> Iterator[tuple[float | F32, int, bool]]:
    """(lux, time, whether its events count)."""
    if light.kind == "any":
        yield from _recorded(light, theta)
        return
    seconds = light.seen.seconds
    if light.kind in ("dark", "still"):
        lux = light.lux or 0.0
        for k in range(math.ceil((WARM_S + seconds) * 1e6 / STILL_US) + 1):
            yield lux, k * STILL_US, k * STILL_US > 1e6 * WARM_S
        return
    assert light.contrast is not None
    assert light.period_s is not None
    bright = light.lux or DIM_LUX * math.sqrt(light.contrast)
    step = math.log(light.contrast)
    half_us = 0.5e6 * light.period_s
    for half in range(math.ceil(seconds * 1e6 / half_us) + 1):
        rising = half % 2 == 0
        for share, late_us in _half(light.kind, half_us):
            part = share if rising else 1.0 - share
            yield bright * math.exp(step * (part - 1.0)), round(half * half_us + late_us), True


def _half(kind: str, half_us: float) -> Iterator[tuple[float, float]]:
    """(share of the step that has come, time) inside half a period."""
    if kind == "ramp":
        for k in range(STEPS):
            yield k / STEPS, k / STEPS * half_us
        return
    yield 0.0, 0.0
    late = float(BLINK_US[0])
    while late < half_us - 1.0:
        yield 1.0, late
        late *= BLINK_US[1]


def _recorded(light: Light, theta: float) -> Iterator[tuple[F32, int, bool]]:
    """The frames of the recording itself, as light."""
    seen, frames = light.seen, frame_light(light.seen)
    if len(frames.mid_us) < 2:
        return
    _without_noise(frames.dn, light.dark_dn, theta)
    # half a step of the converter: black has no logarithm
    over = np.maximum(frames.dn - light.dark_dn, 0.0) + 0.5
    lux = (over * (DIM_LUX / (WHITE - light.dark_dn))).reshape(-1, seen.height, seen.width)
    late_us = (frames.mid_us - frames.mid_us[0]).round().astype(np.int64)
    # backwards first: the pixels begin as such a scene leaves them
    warm = int(np.searchsorted(late_us, 1e6 * WARM_S))
    for one, t_us in zip(lux[1:warm][::-1], late_us[1:warm][::-1], strict=True):
        yield one, int(late_us[warm - 1] - t_us), False
    for one, t_us in zip(lux, late_us, strict=True):
        yield one, int(late_us[warm - 1] + t_us), t_us > 0


def _without_noise(dn: F32, dark: float, theta: float) -> None:
    """Give pixels in which nothing but the noise of the frames moves their mean."""
    still = standing(dn, dark, theta)
    if still.sum() >= FEWEST_PIXELS:
        # the logarithm of dark pixels moves more
        deviation = dn.std(axis=0)
        noise = float(np.median(deviation[still]))
        most = np.abs(dn - dn.mean(axis=0)).max(axis=0)
        still |= (deviation < NOISY * noise) & (most < FAR * noise)
        dn[:, still] = dn[:, still].mean(axis=0)


def cut_to_frames(light: Light) -> Light:
    """A recording between its first frame and its last, to compare with its replay."""
    seen = light.seen
    if light.kind != "any" or len(seen.frames) < 2:
        return light
    middles = [(f.exposure_begin_us + f.exposure_end_us) // 2 for f in seen.frames]
    t = seen.events["t"]
    inside = seen.events[(t > min(middles)) & (t <= max(middles))]
    if len(inside) < 2:
        return light
    return replace(light, seen=replace(seen, events=inside))
