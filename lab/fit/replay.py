"""The recordings again, with the fitted sensor in the camera's place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import SensorParameters
from evs.emulator.simulation.pixels import Pixels
from evs.msgs import EvsError
from evs_lab.fit.camera import Light
from evs_lab.fit.film import Film
from evs_lab.fit.frames import WHITE, frame_light
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

DIM_LUX = 100.0
"""of a lamp or a scene whose light is not known"""

ELECTRON_C = 1.602e-19


def replayed(light: Light, sensor: str | SensorConfig, seed: int = 0) -> Observed | None:
    """The events of the sensor in this light, for as long as the recording.

    Their times count from the beginning of the light, which is the middle of the first exposure if
    it comes from frames.

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
    begin_us = 0
    for lux, t_us, counts in _frames(light, pixels.sensor):
        frame = np.broadcast_to(np.asarray(lux, np.float32), shape)
        events = pixels.observe(frame, t_us)
        if counts:
            parts.append(events)
        else:
            begin_us = t_us
    parts.append(pixels.finish())
    events = np.concatenate(parts)
    events["t"] -= begin_us
    if light.kind != "any":
        # whole periods may be longer than the recording
        events = events[events["t"] <= round(1e6 * light.seen.seconds)]
    try:
        return Observed(events, *size, source=f"{sensor}")
    except EvsError:
        return None


def white_lux(seen: Observed, sensor: SensorParameters) -> float:
    """Illuminance of white in the frames, lux: what fills the sensor's wells in the exposure.

    A sensor without a photocurrent or wells has its bright_lux there, as v2e has for 255 DN.

    Args:
        seen: A recording with frames.
        sensor: The camera.
    """
    exposures_us = [one.exposure_end_us - one.exposure_begin_us for one in seen.frames]
    charge_c = 1e-6 * float(np.median(exposures_us)) * 1e-12 * sensor.photocurrent_pa
    full_c = sensor.aps.full_well_e * ELECTRON_C
    return 1000.0 * full_c / charge_c if full_c * charge_c > 0.0 else sensor.bright_lux


def _frames(light: Light, sensor: SensorParameters) -> Iterator[tuple[float | F32, int, bool]]:
    """(lux, time, whether its events count)."""
    if light.kind == "any":
        yield from _recorded(light, sensor)
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


def _recorded(light: Light, sensor: SensorParameters) -> Iterator[tuple[F32, int, bool]]:
    """The frames of the recording itself, as light."""
    seen, frames = light.seen, frame_light(light.seen)
    if len(frames.mid_us) < 2:
        return
    theta = min(sensor.pos_thres, sensor.neg_thres)
    film = Film(frames, (seen.height, seen.width), light.dark_dn, theta)
    scale = (light.lux or white_lux(seen, sensor)) / (WHITE - light.dark_dn)
    t_us = film.t_us.astype(np.int64)
    # backwards first: the pixels begin as such a scene leaves them
    warm = max(int(np.searchsorted(t_us, 1e6 * WARM_S)), 2)
    for k in range(warm - 1, 0, -1):
        yield film[k] * scale, int(t_us[warm - 1] - t_us[k]), False
    for k in range(len(film)):
        yield film[k] * scale, int(t_us[warm - 1] + t_us[k]), k > 0


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
