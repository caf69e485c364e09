"""SweepRecord: one measured point of a sweep, with its settings, speed and error.

A sweep's file holds one such record a line, as JSON. A line may hold a speed, an error or both, so
that errors can be measured on a busy machine and speeds on a quiet one: `merged` joins the lines
of a point.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from evs.msgs import EvsError, unknown

OURS, FRAMES, PAPER = "ours", "frames", "paper"
KINDS = (OURS, FRAMES, PAPER)
"""evs; frames first and events from frames, as v2e and ESIM; the pipeline of the paper"""

CAMERAS = ("still", "pan", "slide")

STAGES = ("world", "render", "sensor", "pack", "sink")

Setting = str | int | float | bool
"""what a key can be set to"""


@dataclass(frozen=True)
class ConfidenceInterval:
    """A median of repeats and the 95 % confidence interval of it."""

    median: float
    low: float
    high: float
    n: int
    """repeats"""


@dataclass(frozen=True)
class Speed:
    """Cost of a point: the full run and frame, with bus and recorder."""

    real_time_factor: ConfidenceInterval
    """simulated seconds per second of the wall clock"""
    cpu_s_per_s: ConfidenceInterval
    """CPU seconds per simulated second"""
    yardstick_ratio: ConfidenceInterval
    """wall clock of a tick over that of the yardstick, which ran just before and after"""
    stage_ms: Mapping[str, ConfidenceInterval]
    """world, render, sensor, pack, sink: ms of the wall clock a tick"""
    rays_per_tick: float
    """camera samples traced a tick; what follows from a hit (shadows, bounces) is not counted"""
    ticks: int
    """timed ticks of each repeat"""


@dataclass(frozen=True)
class Accuracy:
    """How far events are from those of converged light, as `evs evaluate` defines it.

    NaN: not defined, as a ratio to no events at all.
    """

    emd: float
    """events a pixel: the paper's equation (9)"""
    emd_reference: float
    """the same of one half of the converged light against the other"""
    recall: float
    """share of the reference's events found on their pixel within 3 ms, one to one"""
    precision: float
    """share of the events that have such a partner"""
    spurious_hz: float
    """events without one, per pixel and s"""
    count_ratio_on: float
    """ON events for each of the reference"""
    count_ratio_off: float
    delay_ms: float
    """median over the pairs of stamp less stamp of the reference"""
    timing_ms: float
    """median over the pairs of its size"""
    recall_reference: float
    """recall of one half of the converged light against the other"""


@dataclass(frozen=True)
class SweepRecord:
    """One point on one scene under one camera motion."""

    scene: str
    camera: str
    """still | pan | slide"""
    preset: str
    """the preset that it lies around"""
    axis: str
    """what is varied; empty: the preset itself"""
    value: str
    """of the axis, in words, as in `path 16` or `0.5 ms`"""
    settings: Mapping[str, Setting]
    """keys of a pipeline by their dotted names, those that differ from the preset's"""
    kind: str = OURS
    """ours | frames | paper"""
    speed: Speed | None = None
    error: Accuracy | None = None
    digest: str = ""
    """hash of the scene and the full configuration: a record with another one is outdated"""

    def __post_init__(self) -> None:
        """Raises EvsError: unknown camera motion or kind."""
        for what, name, known in (("camera", self.camera, CAMERAS), ("kind", self.kind, KINDS)):
            if name not in known:
                raise unknown(what, name, known)

    @property
    def point(self) -> tuple[str, str, str, str, str, str]:
        """Identity of the point: (scene, camera, kind, preset, axis, value)."""
        return self.scene, self.camera, self.kind, self.preset, self.axis, self.value

    @property
    def label(self) -> str:
        """The point in words, short: the preset, and what differs from it."""
        return f"{self.preset}, {self.axis} {self.value}" if self.axis else self.preset

    def to_json(self) -> str:
        """One line of strict JSON; null is NaN."""
        return json.dumps(finite(dataclasses.asdict(self)), allow_nan=False)

    @classmethod
    def from_json(cls, line: str) -> SweepRecord:
        """The record of a line.

        Raises:
            EvsError: one line that says what is wrong with it.
        """
        try:
            data = json.loads(line)
        except ValueError as reason:
            raise EvsError(f"no record of a sweep: {reason}; delete the line") from None
        found = _made(cls, data, "")
        settings = _table(found.settings, "settings")
        for key, value in settings.items():
            if not isinstance(value, str | int | float):
                raise _wrong(f"settings.{key}", "a text, a number or true or false")
        speed, error = found.speed, found.error
        if speed is not None:
            speed = _made(Speed, speed, "speed")
            stages = _table(speed.stage_ms, "speed.stage_ms")
            parts = {
                name: _interval(getattr(speed, name), f"speed.{name}")
                for name in ("real_time_factor", "cpu_s_per_s", "yardstick_ratio")
            }
            stage_ms = {k: _interval(v, f"speed.stage_ms.{k}") for k, v in stages.items()}
            rays = number(speed.rays_per_tick, "speed.rays_per_tick")
            ticks = number(speed.ticks, "speed.ticks")
            speed = Speed(**parts, stage_ms=stage_ms, rays_per_tick=rays, ticks=int(ticks))
        if error is not None:
            error = _made(Accuracy, error, "error")
            values = dataclasses.asdict(error)
            error = Accuracy(**{name: number(v, f"error.{name}") for name, v in values.items()})
        for name in ("scene", "camera", "preset", "axis", "value", "kind", "digest"):
            if not isinstance(getattr(found, name), str):
                raise _wrong(name, "a text")
        return dataclasses.replace(found, settings=settings, speed=speed, error=error)


def merged(records: Iterable[SweepRecord]) -> list[SweepRecord]:
    """Each point once, in the order in which it first came; of two speeds the later one counts.

    A record with another digest takes the place of what came before it.
    """
    points: dict[tuple[str, ...], SweepRecord] = {}
    for one in records:
        before = points.get(one.point)
        if before is not None and before.digest == one.digest:
            speed, error = one.speed or before.speed, one.error or before.error
            one = dataclasses.replace(one, speed=speed, error=error)
        points[one.point] = one
    return list(points.values())


_T = TypeVar("_T")


def _made(cls: type[_T], data: Any, where: str) -> _T:
    """The dataclass of a table, its values unchanged."""
    table = _table(data, where or "the line")
    known = [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]
    for key in table:
        if key not in known:
            raise EvsError(f"no record of a sweep: {unknown('key', key, known)}")
    try:
        return cls(**table)
    except TypeError:
        lacking = [f.name for f in dataclasses.fields(cls)  # type: ignore[arg-type]
                   if f.name not in table and f.default is dataclasses.MISSING]  # fmt: skip
        place = f"{where}." if where else ""
        raise EvsError(
            f"no record of a sweep: {place}{lacking[0]} is missing; delete the line"
        ) from None


def _table(data: Any, where: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise _wrong(where, "a table")
    return data


def _interval(data: Any, where: str) -> ConfidenceInterval:
    found = _made(ConfidenceInterval, data, where)
    values = {name: number(v, f"{where}.{name}") for name, v in dataclasses.asdict(found).items()}
    return ConfidenceInterval(values["median"], values["low"], values["high"], int(values["n"]))


def number(data: Any, where: str) -> float:
    """The number of a JSON value, NaN for null.

    Args:
        data: the JSON value.
        where: its place, for messages.

    Raises:
        EvsError: it is not a number.
    """
    if data is None:
        return math.nan
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise _wrong(where, "a number or null")
    return float(data)


def _wrong(where: str, wanted: str) -> EvsError:
    return EvsError(f"no record of a sweep: {where} is not {wanted}; delete the line")


def finite(value: Any) -> Any:
    """Replace NaN and infinity by None, in plain nested values."""
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
