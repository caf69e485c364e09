"""Shards of training data that need no scene: edges and waves of light, and noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from evs_lab.training.settings import SETTINGS_FILE, DataSettings, Variant
from evs_lab.training.shards import Shard, shard_name, write_shard
from evs_lab.training.targets import IDEAL, NOISY, draw_phases, event_counts


def synthetic_shard(
    seed: int,
    pixels: int = 32,
    ticks: int = 448,
    variants: tuple[Variant, ...] = (Variant(4, "fixed"), Variant(4, "fresh")),
) -> Shard:
    """A third of the pixels stands still, a third sees a step, a third waves; noise of 1 / spp."""
    rng = np.random.default_rng([seed, 20])
    t = np.arange(ticks)[:, np.newaxis]
    level = np.exp(rng.uniform(np.log(0.02), np.log(1.0), pixels))
    step = (t > rng.integers(1, max(2, ticks), pixels)) * rng.normal(0.0, 1.0, pixels)
    turn = 2.0 * np.pi / rng.uniform(20.0, 400.0, pixels)
    wave = np.sin(turn * t + rng.uniform(0.0, 6.0, pixels)) * rng.uniform(0.0, 1.0, pixels)
    kind = np.arange(pixels) % 3
    moved = np.where(kind == 1, step, np.where(kind == 2, wave, 0.0))
    truth = (level * np.exp(moved)).astype(np.float32)
    light = []
    for variant in variants:
        shape = (1, pixels) if variant.seeds == "fixed" else (ticks, pixels)
        noise = rng.gamma(4.0 * variant.spp, 1.0 / (4.0 * variant.spp), shape)
        light.append((truth * noise).astype(np.float32))
    phase = draw_phases(rng, pixels)
    return Shard(
        light=np.stack(light),
        truth=truth,
        phase=phase,
        counts=event_counts(truth, phase, IDEAL),
        noisy_counts=event_counts(truth, phase, NOISY, seed=seed),
        pixels=rng.integers(0, (346, 260), (pixels, 2)).astype(np.int16),
        variants=variants,
        meta={"synthetic": seed},
    )


def synthetic_data(folder: Path, shards: int = 3, pixels: int = 32, ticks: int = 448) -> Path:
    """A folder that `Shards` reads."""
    folder.mkdir(parents=True, exist_ok=True)
    variants = (Variant(4, "fixed"), Variant(4, "fresh"))
    settings = DataSettings(pixels=pixels, ticks=ticks, variants=variants)
    (folder / SETTINGS_FILE).write_text(json.dumps(settings.plain()))
    for number in range(shards):
        write_shard(folder / shard_name(number), synthetic_shard(number, pixels, ticks, variants))
    return folder
