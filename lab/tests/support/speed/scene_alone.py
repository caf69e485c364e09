"""A scene of training data with no runner about it: a module that other processes find."""

from __future__ import annotations

from evs_lab.training.make import make_shard
from evs_lab.training.settings import DataSettings

SCENE = DataSettings(pixels=64, truth_spp=64, ticks=64)
"""Of a training scene that takes about a second of one core."""


def scene_alone(number: int) -> int:
    """Its shard, on one thread; how many pixels it has."""
    return make_shard(SCENE, number, threads=1).pixels.shape[0]
