"""Light as an event camera meets it: still, steps, ramps, flicker, moving edges, path noise."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F32

HEIGHT, WIDTH = 36, 40
"""six bands of six rows; 1440 px, no multiple of a block of any runtime"""


def mixed_light(ticks: int, seed: int = 0) -> F32:
    """(ticks, 36, 40) float32 luminance, 1 is white; each band of 6 rows has its kind of light."""
    rng = np.random.default_rng(seed)
    k = np.arange(ticks)[:, None, None]
    column = np.arange(WIDTH)[None, None, :]
    base = np.exp(rng.uniform(np.log(1e-3), np.log(3.0), (1, HEIGHT, WIDTH)))
    light = np.broadcast_to(base, (ticks, HEIGHT, WIDTH)).copy()
    row = np.arange(HEIGHT)[None, :, None]

    def band(number: int, factor: np.ndarray) -> None:
        light[:, 6 * number : 6 * number + 6] *= factor

    # band 0 stands still; 1: steps up and down by up to e^2, 2: ramps, 3: flicker of 100 Hz
    when = rng.integers(5, ticks, (1, 6, WIDTH))
    band(1, np.exp(np.where(k >= when, rng.uniform(-2, 2, (1, 6, WIDTH)), 0.0)))
    band(2, np.exp(k * rng.uniform(-0.03, 0.03, (1, 6, WIDTH))))
    band(3, 1.0 + 0.6 * np.sin(0.2 * np.pi * k + rng.uniform(0, 6, (1, 6, WIDTH))))
    # 4: edges of a bar that moves, 0.05 to 3 px a tick
    speed = np.geomspace(0.05, 3.0, 6)[None, :, None]
    bar = (column - speed * k) % WIDTH
    band(4, np.where(bar < WIDTH / 3, 1.0, 0.15))
    # 5: a slow edge in the noise of 4 fresh samples a pixel
    noise = rng.gamma(4.0, 0.25, (ticks, 6, WIDTH))
    band(5, np.where((column - 0.1 * k) % WIDTH < WIDTH / 2, 1.0, 0.4) * noise)
    # and rows 3 mod 6 of all bands are noisy in bursts
    burst = np.where((row % 6 == 3) & (k % 60 > 45), rng.gamma(16.0, 1 / 16, light.shape), 1.0)
    return (light * burst).astype(np.float32)
