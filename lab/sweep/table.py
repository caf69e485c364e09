"""The result of a sweep as Markdown: presets, axes around them, then other methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from evs.drivers.run.config import PRESETS
from evs_lab.sweep.pareto_front import (
    DEFAULT,
    ERROR_METRICS,
    ErrorMetric,
    cases,
    pareto_front,
    pareto_points,
    unmatched,
)
from evs_lab.sweep.preset_choice import KEYS, choice_text, choose, measured_everywhere
from evs_lab.sweep.record import OURS, STAGES, Accuracy, ConfidenceInterval, Speed, SweepRecord


@dataclass(frozen=True)
class SweepInfo:
    """Facts about all records of a sweep."""

    command: str = ""
    """the command line that made it"""
    machine: str = ""
    """processor, cores, instruction set"""
    versions: Mapping[str, str] = field(default_factory=dict)
    yardstick: str = ""
    """unit of the wall clock"""
    reference: str = ""
    """what errors are against"""


@dataclass(frozen=True)
class RecordColumn:
    """One value of a row."""

    heading: str
    cell: Callable[[SweepRecord], str]


def number(value: float, digits: int = 3) -> str:
    """Format a number with so many digits; a dash where it is not defined."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:,.0f}"


def with_interval(value: ConfidenceInterval) -> str:
    """Format a median and its interval, which a single repeat does not have."""
    if not (math.isfinite(value.low) and math.isfinite(value.high)):
        return number(value.median)
    return f"{number(value.median)} [{number(value.low)}, {number(value.high)}]"


def _speed(of: Callable[[Speed], str]) -> Callable[[SweepRecord], str]:
    return lambda record: "-" if record.speed is None else of(record.speed)


def _error(of: Callable[[Accuracy], float]) -> Callable[[SweepRecord], str]:
    return lambda record: "-" if record.error is None else number(of(record.error))


def _stages(speed: Speed) -> str:
    known = [speed.stage_ms.get(name) for name in STAGES]
    return " / ".join("-" if one is None else number(one.median, 2) for one in known)


COLUMNS = (
    RecordColumn("real-time factor", _speed(lambda s: with_interval(s.real_time_factor))),
    RecordColumn("CPU s per s", _speed(lambda s: with_interval(s.cpu_s_per_s))),
    RecordColumn("yardsticks a tick", _speed(lambda s: with_interval(s.yardstick_ratio))),
    RecordColumn("ms per tick: " + " / ".join(STAGES), _speed(_stages)),
    RecordColumn("rays a tick", _speed(lambda s: number(s.rays_per_tick))),
    RecordColumn("unmatched", _error(lambda e: unmatched(e.recall, e.precision))),
    RecordColumn("EMD", _error(lambda e: e.emd)),
    RecordColumn("recall", _error(lambda e: e.recall)),
    RecordColumn("precision", _error(lambda e: e.precision)),
    RecordColumn("spurious Hz", _error(lambda e: e.spurious_hz)),
    RecordColumn("ON", _error(lambda e: e.count_ratio_on)),
    RecordColumn("OFF", _error(lambda e: e.count_ratio_off)),
    RecordColumn("delay ms", _error(lambda e: e.delay_ms)),
    RecordColumn("timing ms", _error(lambda e: e.timing_ms)),
)

MEANS = """\
Speed is that of the whole run, from simulation to recorder: the median of the repeats and its 95 %
confidence interval. "unmatched" is the share of all events, those of the row and those of the
reference, without a match on the same pixel within 3 ms (1 - F1). It is 1 without any events. EMD
is in events per pixel; alone, it would reward silence. "spurious" gives the unmatched events of the
row, per pixel and second. ON and OFF give the number of events per event of the reference. ● marks
the front: no other row with the same sensor is both faster and less unmatched."""


SHORT = "Each cell gives the real-time factor, unmatched and EMD:"


def markdown(records: Iterable[SweepRecord], about: SweepInfo | None = None) -> str:
    """The whole page.

    Args:
        records: each point once (`merged`).
        about: facts about all of them.
    """
    every = list(records)
    lines = [
        *_about(about or SweepInfo()),
        MEANS,
        "",
        "## Presets",
        "",
        SHORT,
        "",
        *overview(every),
        "",
    ]
    if mean := means(every):
        lines += ["## Means over scenes and cameras", "", *mean, ""]
    if others := peers(every):
        lines += ["## Other programs", "", *others, ""]
    for (scene, camera), subset in cases(every).items():
        lines += [
            f"## {scene}, camera {camera}",
            "",
            reference_error_text(subset),
            "",
            *case_table(subset),
            "",
        ]
    lines += ["## What each preset should be", "", *("    " + line for line in
              choice_text(choose(every)).splitlines())]  # fmt: skip
    return "\n".join(lines) + "\n"


def _about(about: SweepInfo) -> list[str]:
    lines = [f"    {about.command}", ""] if about.command else []
    versions = ", ".join(f"{name} {version}" for name, version in about.versions.items())
    facts = (
        ("Machine", about.machine),
        ("Versions", versions),
        ("Yardstick", about.yardstick),
        ("Reference", about.reference),
    )
    lines += [f"{name}: {words}." for name, words in facts if words]
    return [*lines, ""] if lines else []


def overview(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> list[str]:
    """Lines of Markdown: a row for each scene and camera, a column for each preset.

    Real-time factor, unmatched, EMD of each; the table in lab/docs/sweep.md.
    """
    ours = sorted((r for r in records if r.kind == OURS and not r.axis), key=_preset_rank)
    return _short(ours, [(r.preset, r) for r in ours], "the reference's own", metric)


def means(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> list[str]:
    """Lines of Markdown: every method that was measured everywhere, the fastest first.

    Geometric mean of the real-time factor, arithmetic mean of the error as measured. One that has
    several names is there once: as a preset, else by the first.
    """
    keys = {*KEYS, "scene.tick_us"}
    comparable = [one for one in pareto_points(records, metric) if keys >= {*one.record.settings}]
    comparable.sort(key=lambda one: bool(one.record.axis))
    rows: dict[tuple[float, float], str] = {}
    for one in measured_everywhere(comparable):
        error = math.fsum(point.error for point in one.points) / len(one.points)
        rows.setdefault((one.speed, error), one.label)
    if not rows:
        return []
    return [
        "| configuration | real-time factor | unmatched |",
        "|---|---:|---:|",
        *(f"| {rows[key]} | {number(key[0])} | {number(key[1])} |" for key in sorted(rows)[::-1]),
    ]


def peers(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> list[str]:
    """The same table for methods of other emulators; empty where none was measured."""
    others = [r for r in records if r.kind != OURS]
    # the preset's name matters only where there are several
    several = len({r.preset for r in others}) > 1
    named = [(f"{r.preset}, {r.value}" if several else r.value, r) for r in others]
    return _short(others, named, "", metric)


def _short(
    records: Sequence[SweepRecord],
    named: Sequence[tuple[str, SweepRecord]],
    reference_error: str,
    metric: ErrorMetric,
) -> list[str]:
    columns = list(dict.fromkeys(name for name, _ in named))
    if not columns:
        return []
    headings = ["scene", "camera", *columns, *([reference_error] if reference_error else [])]
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    for (scene, camera), subset in cases(records).items():
        cells = {
            name: _in_short(r, metric)
            for name, r in named
            if (r.scene, r.camera) == (scene, camera)
        }
        row = [scene, camera, *(cells.get(name, "-") for name in columns)]
        if reference_error:
            row.append(", ".join(number(value, 2) for value in reference_errors(subset)) or "-")
        lines.append("| " + " | ".join(row) + " |")
    return lines


def _preset_rank(record: SweepRecord) -> tuple[int, str]:
    return _rank(record.preset)


def _rank(preset: str) -> tuple[int, str]:
    return (PRESETS.index(preset) if preset in PRESETS else len(PRESETS), preset)


def _in_short(record: SweepRecord, metric: ErrorMetric) -> str:
    speed = "-" if record.speed is None else f"{number(record.speed.real_time_factor.median, 2)}x"
    if record.error is None:
        return f"{speed}, -"
    return f"{speed}, {number(metric.of(record.error), 2)}, {number(record.error.emd, 2)}"


def reference_errors(records: Sequence[SweepRecord]) -> list[float]:
    """Error of the reference of a scene itself, by each metric; empty without errors."""
    errors = [r.error for r in records if r.error is not None]
    return (
        [metric.reference_error(errors[0]) for metric in ERROR_METRICS.values()] if errors else []
    )


def reference_error_text(records: Sequence[SweepRecord]) -> str:
    """The same as a sentence."""
    reference_error = reference_errors(records)
    if not reference_error:
        return "No errors were measured here."
    text = ", ".join(
        f"{name} {number(o, 2)}" for name, o in zip(ERROR_METRICS, reference_error, strict=True)
    )
    return f"The reference's own error: {text}. Smaller errors cannot be distinguished."


def case_table(records: Sequence[SweepRecord], metric: ErrorMetric = DEFAULT) -> list[str]:
    """Lines of Markdown for one scene under one camera motion."""
    best = {
        id(pareto_point.record) for pareto_point in pareto_front(pareto_points(records, metric))
    }
    lines = ["| around | axis | value | | " + " | ".join(c.heading for c in COLUMNS) + " |"]
    lines.append("|---|---|---|---|" + "---:|" * len(COLUMNS))
    for record in in_order(records):
        cells = [record.preset, record.axis, record.value, "●" if id(record) in best else ""]
        cells += [column.cell(record) for column in COLUMNS]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def in_order(records: Sequence[SweepRecord]) -> list[SweepRecord]:
    """Sort records: presets, the fastest first; then the axes around each; then other methods."""

    def place(record: SweepRecord) -> tuple[int, tuple[int, str]]:
        if record.kind != OURS:
            return 2, (0, "")
        return (1 if record.axis else 0), _rank(record.preset)

    # sorted is stable: axes and values stay in the order in which they were measured
    axes = list(dict.fromkeys(r.axis for r in records))
    return sorted(records, key=lambda r: (place(r), axes.index(r.axis)))
