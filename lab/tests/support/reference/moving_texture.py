"""A texture that moves before a camera with frames: events and frames of a random sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import evs
from evs_lab.fit import Observed

WIDTH, HEIGHT = 64, 48
LAWS = {"dim_lux": 1.0, "dark_lux": 0.01, "log": "ln", "shot_noise_bright": 0.3}
"""of all sensors"""

SIZE = 512
"""of the texture, which repeats"""

WARM_S = 10.0
"""before the recording: it begins in the middle of the pixels' life"""


@dataclass(frozen=True)
class Drawn:
    """A sensor and its scene."""

    sensor: dict[str, float]
    """keys of [sensor] that a fit may find"""
    dark: int
    """what the frames add to the light, DN"""
    scene: dict[str, Any]


def drawn(episode: int) -> Drawn:
    """A random sensor: thresholds, mismatch, leak, noise, dark level; and a random scene."""
    random = np.random.default_rng([77, episode])

    def decade(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    sensor = {
        "pos_thres": random.uniform(0.12, 0.4),
        "neg_thres": random.uniform(0.12, 0.4),
        "sigma_thres": random.uniform(0.01, 0.05),
        "leak_rate_hz": decade(0.05, 1.0),
        "shot_noise_rate_hz": decade(0.02, 1.0),
        "noise_rate_cov_decades": random.uniform(0.1, 0.3),
        "refractory_period_s": decade(2e-5, 1e-3),
        "cutoff_hz": decade(100.0, 1000.0),
    }
    scene = {
        "blur_px": random.uniform(1.25, 4.0),
        "contrast": random.uniform(0.35, 0.65),
        "speed_px_s": random.uniform(15.0, 60.0),
        "mean_dn": random.uniform(50.0, 80.0),
        "exposure_us": int(decade(500.0, 10_000.0)),
        "full_well_e": decade(5000.0, 20_000.0),
        "read_noise_dn": random.uniform(0.0, 3.0),
        "seconds": random.uniform(2.0, 6.0),
        # patches with hard edges; a camera that swings; a background that stands still
        "hard": episode % 3 == 1,
        "swings": episode % 3 == 2,
        "still": 0.3 if episode % 4 == 0 else 0.0,
    }
    return Drawn(sensor, int(random.integers(0, 17)), scene)


def recorded(episode: int, drawing: Drawn | None = None) -> Observed:
    """Its recording: events, and frames at 25 Hz."""
    one = drawing or drawn(episode)
    scene = one.scene
    random = np.random.default_rng([78, episode])
    texture = _texture(random, scene)
    pixels = evs.Pixels(
        "ideal",
        size=(WIDTH, HEIGHT),
        unit="dn",
        seed=1000 + episode,
        **LAWS,
        **one.sensor,
        **{
            "aps.enabled": True,
            "aps.rate_hz": 25.0,
            **{f"aps.{key}": scene[key] for key in ("exposure_us", "full_well_e", "read_noise_dn")},
        },
    )
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    angle = random.uniform(0.0, 2.0 * np.pi)
    standing = int(WIDTH * scene["still"])
    parts, frames = [], []
    begin_us = round(1e6 * WARM_S)
    times_us = [*range(0, begin_us, 50_000)]
    times_us += range(begin_us, begin_us + round(1e6 * scene["seconds"]), 1000)
    for t_us in times_us:
        t = max(1e-6 * t_us - WARM_S, 0.0)
        way = scene["speed_px_s"] * (np.sin(2.0 * t) if scene["swings"] else t)
        right = way * np.cos(angle) + 12.0 * np.sin(3.0 * t)
        down = way * np.sin(angle) + 9.0 * np.sin(2.1 * t + 1.0)
        light = scene["mean_dn"] * np.exp(_sampled(texture, x + right, y + down))
        light[:, :standing] = scene["mean_dn"] * np.exp(texture[:HEIGHT, :standing])
        events = pixels.observe(light.astype(np.float32), t_us)
        if t_us <= begin_us:
            continue
        parts.append(events)
        for frame in pixels.frames:
            grey = np.clip(frame.pixels.astype(np.int64) + one.dark, 0, 255).astype(np.uint8)
            frames.append(replace(frame, pixels=grey))
    return Observed(np.concatenate(parts), WIDTH, HEIGHT, f"sensor {episode}", tuple(frames))


def _texture(random: np.random.Generator, scene: dict[str, Any]) -> np.ndarray[Any, Any]:
    """(SIZE, SIZE) ln light, with the contrast as standard deviation."""
    k = 2.0 * np.pi * np.fft.fftfreq(SIZE)
    low = np.exp(-0.5 * (k[:, None] ** 2 + k**2) * scene["blur_px"] ** 2)
    soft = np.fft.ifft2(np.fft.fft2(random.standard_normal((SIZE, SIZE))) * low).real
    soft *= scene["contrast"] / soft.std()
    if not scene["hard"]:
        return np.asarray(soft)
    flat = np.abs(soft) > 0.3 * scene["contrast"]
    return np.where(flat, np.sign(soft) * scene["contrast"], soft)


def _sampled(texture: np.ndarray[Any, Any], x: Any, y: Any) -> np.ndarray[Any, Any]:
    """The texture between its points."""
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = x - left, y - top
    left, top = left % SIZE, top % SIZE
    beside, below = (left + 1) % SIZE, (top + 1) % SIZE
    upper = texture[top, left] * (1.0 - right) + texture[top, beside] * right
    lower = texture[below, left] * (1.0 - right) + texture[below, beside] * right
    return np.asarray(upper * (1.0 - down) + lower * down)
