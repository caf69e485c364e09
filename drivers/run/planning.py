"""The plan of a pipeline: what its scene requires and, on request, how long it takes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from evs.drivers.clock import StopWatch
from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.run import run
from evs.emulator.camera.scene_plan import ScenePlan
from evs.emulator.simulation.world import World

MEASURED = ("world", "render", "sensor")
"""the stages that a plan measures"""


@dataclass(frozen=True)
class Measured:
    """A few ticks, run for their time; no sinks."""

    ended: str
    """complete, or what ended it, as in a run's report"""
    ticks: int
    stage_ms: dict[str, float]
    """stage -> ms of a tick, median"""
    traced_fraction: float
    """share of the pixels that were traced, mean"""
    events: int


@dataclass(frozen=True)
class PipelinePlan:
    """Of a pipeline with its one camera."""

    scene: str
    camera: str
    sensor: str
    model: str
    renderer: str
    sinks: tuple[str, ...]
    threads: int
    """0: one per core"""
    plan: ScenePlan
    measured: Measured | None = None

    def plain(self) -> dict[str, Any]:
        """For JSON: the same `plan` as in a run's report."""
        plain = {key: getattr(self, key) for key in ("scene", "camera", "sensor", "model")}
        measured = asdict(self.measured) if self.measured else None
        return {
            **plain,
            "renderer": self.renderer,
            "sinks": list(self.sinks),
            "threads": self.threads,
            "plan": self.plan.compact(),
            "measured": measured,
        }


def plan_pipeline(config: PipelineConfig, ticks: int = 0) -> PipelinePlan:
    """Load the scene, render it once and return what it requires.

    The first tick is made in any case: some code paths depend on where things are.

    Args:
        config: Of the pipeline.
        ticks: How many to measure; 0: none.
    """
    watch = StopWatch()
    world = World.from_config(config, meter=watch)
    measured = None
    if ticks:
        report = run(world, [], ticks * config.scene.tick_us / 1e6, watch)
        measured = Measured(
            report.ended,
            report.ticks,
            {stage: report.stage_ms[stage].median for stage in MEASURED},
            report.traced_fraction,
            report.events,
        )
    else:
        world.step()
    (camera,) = world.cameras
    return PipelinePlan(
        scene=config.scene.file,
        camera=camera.bound.name,
        sensor=str(camera.sensor.name),
        model=config.model.name,
        renderer=config.render.renderer,
        sinks=tuple(sink.type for sink in config.sinks()),
        threads=config.threads,
        plan=camera.plan,
        measured=measured,
    )
