"""The world of a pipeline in an open loop: nobody answers to its events, so light may go ahead."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from evs.drivers.clock import StopWatch
from evs.drivers.cores import cores
from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.run import tick_count
from evs.emulator.simulation.pipelined import PipelinedWorld, pipelined
from evs.emulator.simulation.world import World


@contextmanager
def open_world(config: PipelineConfig, watch: StopWatch) -> Iterator[World | PipelinedWorld]:
    """What a run loop steps, for `config.duration_s` and no longer. In: watch, what it laps."""
    ticks = tick_count(config.duration_s, config.scene.tick_us)
    world = World.from_config(config.emulation(), meter=watch)
    with pipelined(world, ticks, watch, depth_of(config)) as running:
        yield running


def depth_of(config: PipelineConfig) -> int:
    """How many ticks ahead light is made: none with one thread, or on one core."""
    alone = config.threads == 1 or cores() == 1
    return 0 if alone else config.ahead
