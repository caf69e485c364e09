"""Describe a folder of training data in a few lines."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from evs.tools.training.pilot import WHITE_DN
from evs.tools.training.shards import Shards

LIGHT_STEP = 7
"""Every so many ticks count where light is described."""


def describe(shards: Shards) -> list[tuple[str, str]]:
    """(what, how much): light, events, speeds and kinds of all shards, read one by one."""
    light, events, noisy, medians, fastest = [], [], [], [], []
    kinds: Counter[str] = Counter()
    for shard in shards:
        dn = WHITE_DN * shard.truth[::LIGHT_STEP]
        light.append(dn.ravel())
        medians.append(float(np.median(dn)))
        events.append(shard.counts.sum((0, 1), dtype=np.int64))
        noisy.append(shard.noisy_counts.sum((0, 1), dtype=np.int64))
        kinds[str(shard.meta.get("scene", {}).get("kind", "unknown"))] += 1
        seen = shard.meta.get("seen", {}).get("speeds_px_s")
        fastest.append(float(seen[-1]) if seen else 0.0)
    counts = np.concatenate(events)
    return [
        ("scenes", f"{len(shards)}: " + ", ".join(f"{n} {k}" for k, n in sorted(kinds.items()))),
        ("pixels", f"{len(counts):,}, each {shards.settings.ticks} ticks"),
        ("light, DN", _told(np.concatenate(light), (1, 5, 25, 50, 75, 95, 99))),
        ("median of a scene, DN", _told(np.array(medians), (0, 10, 50, 90, 100))),
        ("pixels with events", f"{100 * np.mean(counts > 0):.3g} %"),
        ("events of a pixel", f"mean {counts.mean():.4g}; " + _told(counts, (50, 90, 99, 100))),
        ("the same with noise", f"mean {np.concatenate(noisy).mean():.4g}"),
        ("fastest 1 % of a scene, px/s", _told(np.array(fastest), (0, 10, 25, 50, 75, 90, 100))),
    ]


def _told(values: Any, shares: tuple[int, ...]) -> str:
    """Percentiles as words."""
    found = np.percentile(values, shares)
    return ", ".join(f"{share} %: {value:.3g}" for share, value in zip(shares, found, strict=True))
