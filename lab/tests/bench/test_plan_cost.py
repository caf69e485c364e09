"""What code paths cost that nothing needs: CPU time of one thread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time

import pytest

from evs.drivers.clock import StopWatch
from evs.drivers.run.run import run
from evs.emulator.base.features import FEATURES
from evs.emulator.config import (
    CameraConfig,
    PlanConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
)
from evs.emulator.simulation.world import World

pytestmark = pytest.mark.bench

STAGES = ("world", "render", "sensor")


def config(file: Path, renderer: str, spp: int) -> RunConfig:
    """A free camera that stands still, so that all motion is the robot's."""
    return RunConfig(
        scene=SceneConfig(file=str(file), control="random"),
        camera=CameraConfig(azimuth=70, elevation=-20),
        sensor=SensorConfig(),
        render=RenderConfig(renderer=renderer, spp=spp, antialiasing="fixed"),
        threads=1,
    )


def measured(wanted: RunConfig, ticks: int, on: Sequence[str]) -> dict[str, float]:
    """CPU ms of each stage of a tick, median."""
    watch = StopWatch(process_time)
    world = World.from_config(replace(wanted, plan=PlanConfig(on=tuple(on))), meter=watch)
    report = run(world, [], ticks * 1e-3, watch)
    return {stage: report.stage_ms[stage].median for stage in STAGES}


def test_code_paths_that_nothing_needs(robot_files: dict[str, Path]) -> None:
    """gymnasium's reacher, which has no sky, no texture and no shadow; each idle path by itself."""
    wanted = config(robot_files["gymnasium/reacher"], "direct", 4)
    # traced whole in both, so that the code path itself is what differs
    base = [measured(wanted, 40, ["full_retrace"]) for _ in range(3)]
    yardstick = {stage: min(one[stage] for one in base) for stage in STAGES}
    print("\nCPU time of render and sensor over that without it")
    for feature in FEATURES:
        if feature.idle or feature.name in ("full_retrace", "cold_tiles"):
            continue
        took = [measured(wanted, 40, ["full_retrace", feature.name]) for _ in range(3)]
        best = {stage: min(one[stage] for one in took) for stage in STAGES}
        ratios = [f"{best[stage] / yardstick[stage]:.2f}" for stage in ("render", "sensor")]
        print(f"{feature.name:18s} render x{ratios[0]}, sensor x{ratios[1]}")
    whole = measured(wanted, 40, ["full_retrace"])["render"]
    kept = measured(wanted, 40, [])["render"]
    everything = replace(wanted, plan=PlanConfig(everything=True))
    watch = StopWatch(process_time)
    run(World.from_config(everything, meter=watch), [], 0.04, watch)
    all_ms = sum(watch.stage_ms(STAGES)[stage].median for stage in STAGES)
    bare_ms = sum(yardstick.values()) - yardstick["render"] + kept
    print(f"full_retrace: render x{whole / kept:.1f}; everything: the tick x{all_ms / bare_ms:.1f}")
