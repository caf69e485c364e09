"""Statistics of a run: what its world did, for the report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from evs.drivers.clock import StopWatch
from evs.drivers.run.config_lint import lint
from evs.drivers.run.report import STAGES, Report, versions
from evs.drivers.run.sink_set import AuxiliaryStreams
from evs.emulator.base.scene import F32
from evs.msgs import EventPacket


class PlanSummary(Protocol):
    """The plan of a camera's scene; evs.emulator's ScenePlan is one."""

    def compact(self) -> dict[str, Any]:
        """Return contents, code paths that are on, and why the others are off, in plain values."""


class RunCamera(AuxiliaryStreams, Protocol):
    """A camera as a run sees it."""

    @property
    def traced_fraction(self) -> float:
        """Share of the pixels that the last tick traced."""

    @property
    def clamps(self) -> int:
        """How often a value had to be clamped or replaced so far."""

    @property
    def events_dropped(self) -> Mapping[str, int]:
        """Events that its readout dropped so far, by cause; empty where it drops none."""

    @property
    def events_waiting(self) -> int:
        """Events that are still on their way through its readout."""

    @property
    def rebuilt(self) -> Mapping[str, int]:
        """How often its scene was built again, as its model was edited; of that, what."""

    @property
    def plan(self) -> PlanSummary:
        """What its scene requires."""

    @property
    def is_dark(self) -> bool:
        """Whether nothing was lit in the last tick."""

    @property
    def luminance(self) -> F32:
        """(h, w) float32 linear luminance of the last tick."""


class RunWorld(Protocol):
    """A world as a run sees it; evs.emulator.World is one."""

    @property
    def cameras(self) -> Sequence[RunCamera]:
        """All of them, in their order."""

    @property
    def t_us(self) -> int:
        """Simulated time, us."""

    @property
    def left_out(self) -> Sequence[str]:
        """One line for each thing of its model that is not shown; some are known once it begins."""

    @property
    def substeps(self) -> object:
        """Its str() describes how the model's time step was fitted to the tick."""

    def step(self) -> tuple[EventPacket, ...]:
        """Advance one tick; its packets."""

    def finish(self) -> tuple[EventPacket, ...]:
        """The packets of ticks that were to leave together with later ones."""


_CLAMPS = "clamps"
"""no cause of a drop"""


class Totals:
    """The sum of counts whose owner may be reset or restored, so that they jump."""

    def __init__(self, read: Callable[[], Mapping[Any, int]]) -> None:
        """Sum counts.

        Args:
            read: Returns the counts as they are now, each under its name.
        """
        self._read = read
        self._base: Mapping[Any, int] = {}
        self._sum = Counter[Any]()

    def read(self) -> Mapping[Any, int]:
        """Return the counts as they are now, for `jumped` after a jump that may yet fail."""
        return self._read()

    def jumped(self, before: Mapping[Any, int]) -> None:
        """Record that the counts have jumped; `before` is what they were."""
        for name, count in before.items():
            self._sum[name] += count - self._base.get(name, 0)
        self._base = self._read()

    def now(self) -> dict[Any, int]:
        """Return the sum over all jumps."""
        found = self._read()
        names = dict.fromkeys([*self._sum, *found])
        return {k: self._sum[k] + found.get(k, 0) - self._base.get(k, 0) for k in names}


class RunStatistics:
    """Counts what a world does, over all its resets."""

    def __init__(self, world: RunWorld, watch: StopWatch) -> None:
        self._world, self._watch = world, watch
        self.ticks = 0
        self.packets = 0
        self.events: dict[str, int] = {}
        """of each camera"""
        self._traced = 0.0
        self._warned_clamps = set[str]()
        self.totals = Totals(self._counts)

    def count_tick(self) -> None:
        """Count a tick that is done."""
        self.ticks += 1
        cameras = self._world.cameras
        self._traced += sum([camera.traced_fraction for camera in cameras]) / max(1, len(cameras))

    def count_packets(self, packets: Sequence[EventPacket]) -> None:
        """Count packets that left the cameras."""
        for packet in packets:
            self.events[packet.camera] = self.events.get(packet.camera, 0) + len(packet)
        self.packets += len(packets)

    def new_warnings(self) -> list[str]:
        """Return the warnings of this tick, each once a camera. Call after every tick.

        After the first tick: a camera sees no lit surface, and settings that are unlikely to be
        intended. Later: values had to be replaced.
        """
        lines = []
        for camera in self._world.cameras:
            if self.ticks == 1:
                name = camera.info.camera
                mean = float(np.mean(camera.luminance, dtype=np.float64))
                lines += lint(name, camera.info.config, camera.info.camera_info, mean)
                if camera.is_dark:
                    lines.append(
                        f"camera '{name}' sees no lit surface, so the picture is dark: give the "
                        "scene a light, or use its headlight (render.headlight=model); if the "
                        "whole scene is nearer than the near plane, lower camera.near_m"
                    )
            if camera.clamps and camera.info.camera not in self._warned_clamps:
                name = camera.info.camera
                self._warned_clamps.add(name)
                lines.append(
                    f"camera '{name}': {camera.clamps:,} values in tick {self.ticks:,} were "
                    "invalid or out of range and were replaced or clamped (light that is negative, "
                    "NaN or infinite, or a network's input or membrane potential beyond its "
                    "limit); the run report counts them as clamps: look for a material or a light "
                    "that is far too strong"
                )
        return lines

    def report(
        self,
        *,
        ended: str,
        sim_seconds: float,
        wall_seconds: float,
        sinks: list[dict[str, Any]],
        warnings: list[str],
        config: dict[str, Any],
        pace: dict[str, Any] | None = None,
        loop: dict[str, Any] | None = None,
        sensor_changes: Sequence[dict[str, Any]] = (),
    ) -> Report:
        """Return the report of the whole run; arguments as its fields."""
        cameras = self._world.cameras
        infos = [camera.info for camera in cameras]
        known = {k: v for info in infos for k, v in info.versions.items()}
        totals = self.totals.now()
        lost = {camera.info.camera: dict[str, int]() for camera in cameras}
        for (camera, cause), count in totals.items():
            if cause != _CLAMPS:
                lost[camera][cause] = count
        cameras_plain = [
            _camera(camera, self.events, lost[camera.info.camera]) for camera in cameras
        ]
        return Report(
            ended=ended,
            real_time_factor=sim_seconds / wall_seconds if wall_seconds else 0.0,
            ticks=self.ticks,
            sim_seconds=sim_seconds,
            wall_seconds=wall_seconds,
            packets=self.packets,
            events=sum(self.events.values()),
            events_dropped=sum(int(sink.get("events_dropped", 0)) for sink in sinks)
            + sum(sum(one["events_dropped"].values()) for one in cameras_plain),
            events_waiting=sum(camera.events_waiting for camera in cameras),
            stage_ms=self._watch.stage_ms(STAGES),
            traced_fraction=self._traced / self.ticks if self.ticks else 0.0,
            clamps=sum(count for (_, cause), count in totals.items() if cause == _CLAMPS),
            seed=infos[0].seed if infos else 0,
            substeps=str(self._world.substeps),
            cameras=cameras_plain,
            sinks=sinks,
            pace=pace or {},
            loop=loop or {},
            sensor_changes=list(sensor_changes),
            warnings=warnings,
            versions={**versions(), **known},
            config=config,
        )

    def _counts(self) -> dict[tuple[str, str], int]:
        """(camera, cause) -> events that its readout dropped, and its clamps."""
        found: dict[tuple[str, str], int] = {}
        for camera in self._world.cameras:
            name = camera.info.camera
            found |= {(name, cause): count for cause, count in camera.events_dropped.items()}
            found[name, _CLAMPS] = camera.clamps
        return found


def _camera(
    camera: RunCamera, events: Mapping[str, int], dropped: Mapping[str, int]
) -> dict[str, Any]:
    info = camera.info
    return {
        "name": info.camera,
        "sensor": info.sensor,
        "parameters": info.config.get("sensor", {}),
        "width": info.width,
        "height": info.height,
        "tick_us": info.tick_us,
        "latency_us": info.latency_us,
        "events": events.get(info.camera, 0),
        "events_dropped": dict(dropped),
        "events_waiting": camera.events_waiting,
        "rebuilt": dict(camera.rebuilt),
        "camera_info": info.camera_info,
        "plan": camera.plan.compact(),
    }
