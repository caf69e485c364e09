"""Choose the presets from the measured points by one rule.

A preset is measured on every scene and camera of the sweep at once: by the geometric mean of its
real-time factors, and by the mean of its errors. fast is the most accurate configuration that keeps
real time, balanced the most accurate at a tenth of it, accurate at a hundredth; reference is the
most accurate of all, and of those that the reference cannot tell from itself the fastest. If
nothing is fast enough, the fastest configuration is taken. What must keep up with one scene on one
machine is what `evs tune` is for. A preset says how light
becomes events, so points that change the sensor, the tick (which is the pace of a closed loop, too)
or the machine are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from evs.drivers.run.config import PRESETS
from evs_lab.sweep.pareto_front import DEFAULT, ErrorMetric, ParetoPoint, pareto_points
from evs_lab.sweep.record import OURS, SweepRecord

DEMANDS = dict(zip(PRESETS, (1.0, 0.1, 0.01, 0.0), strict=True))
"""preset -> the real-time factor that it must reach on the mean of the scenes"""
SLACK = 0.95
"""share of it that counts as reached: what the same run moves by from hour to hour"""

KEYS = (
    *("render.renderer", "render.spp", "render.antialiasing", "render.seeds", "render.bounces"),
    *("render.cycle_ticks", "render.sampler", "model.name", "model.network", "model.chunk"),
)
"""keys that a preset may set"""


@dataclass(frozen=True)
class PresetCandidate:
    """One configuration on all scenes of a sweep."""

    label: str
    points: tuple[ParetoPoint, ...]
    """one of each scene and camera"""

    @property
    def speed(self) -> float:
        """Real-time factor, geometric mean over the scenes."""
        return math.exp(
            math.fsum(math.log(point.speed) for point in self.points) / len(self.points)
        )

    @property
    def least(self) -> float:
        """Real-time factor where it is slowest."""
        return min(point.speed for point in self.points)

    @property
    def slowest(self) -> SweepRecord:
        """Where that is."""
        return min(self.points, key=lambda point: point.speed).record

    @property
    def error(self) -> float:
        """Mean over the scenes, not below the error of the reference."""
        return math.fsum(point.visible_error for point in self.points) / len(self.points)


@dataclass(frozen=True)
class PresetChoice:
    """Which configuration a preset should be."""

    preset: str
    demand: float
    """real-time factor"""
    chosen: PresetCandidate
    reached: bool
    """whether the demand is met"""

    @property
    def stays(self) -> bool:
        """Whether that is what the preset is already."""
        return self.chosen.label == self.preset


def preset_candidates(
    records: Iterable[SweepRecord], metric: ErrorMetric = DEFAULT
) -> list[PresetCandidate]:
    """The configurations that a preset could be and that were measured on every scene."""
    ours = [p for p in pareto_points(records, metric) if p.record.kind == OURS]
    return [
        one
        for one in measured_everywhere(ours)
        if all(key in KEYS for point in one.points for key in point.record.settings)
    ]


def measured_everywhere(points: Iterable[ParetoPoint]) -> list[PresetCandidate]:
    """The configurations that have a point on every scene and camera of all of them."""
    found: dict[str, dict[tuple[str, str], ParetoPoint]] = {}
    for point in points:
        record = point.record
        found.setdefault(record.label, {})[record.scene, record.camera] = point
    places = {place for at in found.values() for place in at}
    return [
        PresetCandidate(label, tuple(at.values()))
        for label, at in found.items()
        if at.keys() == places
    ]


def choose(records: Iterable[SweepRecord], metric: ErrorMetric = DEFAULT) -> list[PresetChoice]:
    """One choice for each preset that was measured on every scene."""
    eligible = preset_candidates(records, metric)
    known = {one.label for one in eligible}
    # presets that were not swept have no choice
    return [
        _chosen(preset, demand, eligible) for preset, demand in DEMANDS.items() if preset in known
    ]


def _chosen(preset: str, demand: float, eligible: Sequence[PresetCandidate]) -> PresetChoice:
    quick = [one for one in eligible if one.speed >= SLACK * demand]
    if quick:
        # of equally accurate ones the faster, and then what the preset is already
        best = min(quick, key=lambda one: (one.error, -one.speed, one.label != preset))
    else:
        best = max(eligible, key=lambda one: (one.speed, -one.error))
    return PresetChoice(preset, demand, best, bool(quick))


def choice_text(choices: Sequence[PresetChoice], metric: ErrorMetric = DEFAULT) -> str:
    """Text: what each preset should be, why, and with which keys."""
    if not choices:
        return "no preset was measured on every scene: presets cannot be chosen\n"
    lines = []
    for choice in choices:
        chosen, record = choice.chosen, choice.chosen.slowest
        verdict = "stays" if choice.stays else f"should be: {chosen.label}"
        lines.append(f"{choice.preset:10s}{verdict}")
        where = f"{record.scene}, {record.camera}"
        lines.append(
            f"{'':10s}{metric.label}, mean: {chosen.error:.3g}; real-time factor "
            f"{chosen.speed:.3g}, {chosen.least:.3g} where it is slowest ({where})"
        )
        if not choice.reached:
            lines.append(f"{'':10s}nothing reaches {choice.demand:g}; this is the fastest")
        if not choice.stays and record.settings:
            keys = " ".join(f"{key}={value}" for key, value in record.settings.items())
            lines.append(f"{'':10s}evs emulate {record.preset} {keys}")
    there = {choice.preset for choice in choices}
    lines += [f"{name:10s}was not measured everywhere" for name in DEMANDS if name not in there]
    return "\n".join(lines) + "\n"
