"""The readout in plain Python, written to be read: a whole run at once, one event after another.

It shares only the definition of the random numbers with the native one. Times are exact, in ns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from evs.emulator.sensor import ReadoutParameters, SensorParameters
from evs.emulator.sensor.random import _cos_turn, _hash, _log, _uniform
from evs.msgs import Events


@dataclass(frozen=True)
class Event:
    """An event as it left its pixel."""

    t: int
    x: int
    y: int
    p: int
    cause: int = 0


@dataclass
class Told:
    """What became of the events of a run."""

    out: list[tuple[int, Event]] = field(default_factory=list)
    """(stamp in us, event), in the order in which they came out"""
    dropped: Counter[str] = field(default_factory=Counter)
    waiting: int = 0


def sensor_of(
    latency_us: float = 0.0, latency_sigma_us: float = 0.0, **readout: Any
) -> SensorParameters:
    """Parameters of 64 x 48 noise-free pixels, behind a readout with these parameters."""
    return SensorParameters(
        "test",
        64,
        48,
        0.2,
        0.2,
        latency_us=latency_us,
        latency_sigma_us=latency_sigma_us,
        readout=ReadoutParameters(**readout),
    )


def tell(sensor: SensorParameters, seed: int, events: Iterable[Event], end_us: int) -> Told:
    """Read a run out until `end_us`.

    Args:
        sensor: The sensor and its readout.
        seed: The seed of the random numbers.
        events: All events of the run, sorted by t.
        end_us: The end of the run.
    """
    told = Told()
    asked = sorted(_asked(sensor, seed, events, told), key=lambda request: request[0])
    due = [request for request in asked if request[0] <= end_us * 1000]
    told.waiting += len(asked) - len(due)
    order = {"ideal": lambda *_: due, "arbiter": _arbiter, "scan": _scan}[sensor.readout.order]
    passed = _controlled(sensor, order(sensor, seed, due, end_us, told), told)
    for ns, event in _linked(sensor, passed, told):
        if ns > end_us * 1000:
            told.waiting += 1
        else:
            told.out.append((math.ceil(Fraction(ns, 1000)), event))
    return told


def as_bytes(told: Told) -> bytes:
    """The events that came out, 16 bytes each."""
    numbers = [
        stamp.to_bytes(8, "little", signed=True)
        + event.x.to_bytes(2, "little")
        + event.y.to_bytes(2, "little")
        + bytes([event.p, event.cause, 0, 0])
        for stamp, event in told.out
    ]
    return b"".join(numbers)


def as_events(events: Events) -> list[Event]:
    """The events of an array as plain ones."""
    causes = events.view(np.uint8).reshape(-1, 16)[:, 13]
    columns = (events["t"], events["x"], events["y"], events["p"], causes)
    return [Event(*map(int, row)) for row in zip(*columns, strict=True)]


Requests = list[tuple[int, Event]]


def _asked(
    sensor: SensorParameters, seed: int, events: Iterable[Event], told: Told
) -> Iterable[tuple[int, Event]]:
    """Yield (time of its pixel's request, event) for each event that may be read."""
    readout = sensor.readout
    rectangles = [readout.roi[i : i + 4] for i in range(0, len(readout.roi), 4)]
    masked = {readout.mask[i : i + 2] for i in range(0, len(readout.mask), 2)}
    for event in events:
        inside = [
            x <= event.x < x + wide and y <= event.y < y + high for x, y, wide, high in rectangles
        ]
        if rectangles and not any(inside):
            told.dropped["roi"] += 1
        elif (event.x, event.y) in masked:
            told.dropped["mask"] += 1
        else:
            late_us = sensor.latency_us
            if sensor.latency_sigma_us:
                key = _bits(_bits(seed, 64 + 1), ((event.y << 32) | (event.x << 1)) + 1)
                late_us += sensor.latency_sigma_us * _normal(key, (event.t << 2) + 2 * event.p)
            early_ns = 0
            if readout.order == "arbiter" and readout.phase_ns:
                key = _bits(_bits(seed, 67 + 1), ((event.y << 32) | (event.x << 1)) + 1)
                draw = _bits(key, (event.t << 1) + event.p) >> 32
                early_ns = draw * (readout.phase_ns + 1) >> 32
            yield event.t * 1000 + _whole(late_us * 1000.0) - early_ns, event


def _arbiter(
    sensor: SensorParameters, seed: int, due: Requests, end_us: int, told: Told
) -> Requests:
    """Return (time at which it was read, event); each pixel holds at most one event."""
    readout = sensor.readout
    held: dict[tuple[int, int], Event] = {}
    coming = list(due)
    read: Requests = []

    def come(until_ns: int) -> None:
        while coming and coming[0][0] <= until_ns:
            event = coming.pop(0)[1]
            if (event.x, event.y) in held:
                told.dropped["busy"] += 1
            else:
                held[event.x, event.y] = event

    free_ns, last_row, accesses = -(10**30), -1, 0
    while True:
        come(min(free_ns, end_us * 1000))
        if not held and coming:
            free_ns = max(free_ns, coming[0][0])
            come(free_ns)
        if not held or free_ns > end_us * 1000:
            break
        row = min({y for _, y in held}, key=lambda y: (y - last_row - 1) % sensor.height)
        access_ns = float(readout.row_ns)
        if readout.jitter_ns:
            access_ns += readout.jitter_ns * _normal(_bits(seed, 65 + 1), accesses << 1)
        accesses += 1
        latch_ns = free_ns + _whole(access_ns)
        if latch_ns > end_us * 1000:
            break
        come(latch_ns)
        from_right = bool(_bits(_bits(seed, 66 + 1), accesses) & 1)
        columns = sorted((x for x, y in held if y == row), reverse=from_right)
        read += [(latch_ns, held.pop((x, row))) for x in columns]
        free_ns, last_row = latch_ns + len(columns) * readout.column_ns, row
    come(end_us * 1000)
    told.waiting += len(held)
    return read


def _scan(sensor: SensorParameters, _: int, due: Requests, end_us: int, told: Told) -> Requests:
    """Return (time at which it was read, event) for the first event of each pixel and scan."""
    readout = sensor.readout
    step_ns = readout.scan_us * 1000
    coming = list(due)
    read: Requests = []
    free = -(10**30)  # number of the first scan that may be read
    while coming:
        # the first scan that sees the next event holds all that came until then
        number = -(-max(-(-coming[0][0] // step_ns), free) // readout.scan_every)
        number *= readout.scan_every
        held: dict[tuple[int, int, int], Event] = {}
        while coming and coming[0][0] <= number * step_ns:
            event = coming.pop(0)[1]
            column = event.x if readout.scan_from == "left" else sensor.width - 1 - event.x
            place = ((column + 1) * readout.scan_column_ns, event.y, event.x)
            if place in held:
                told.dropped["scan"] += 1
            else:
                held[place] = event
        read += [(number * step_ns + place[0], held[place]) for place in sorted(held)]
        free = number + (-(-len(held) // readout.scan_events) if readout.scan_events else 1)
    done = [request for request in read if request[0] <= end_us * 1000]
    told.waiting += len(read) - len(done)
    return done


def _controlled(sensor: SensorParameters, read: Requests, told: Told) -> Requests:
    """Return the events that event rate control lets through."""
    readout = sensor.readout
    if not readout.erc_target:
        return read
    periods: dict[int, Requests] = {}
    for ns, event in read:
        stamp_us = -(-ns // 1000)
        periods.setdefault(-(-stamp_us // readout.erc_period_us), []).append((ns, event))
    passed: Requests = []
    for number, events in periods.items():
        before, target = len(periods.get(number - 1, [])), readout.erc_target
        good = [
            request
            for i, request in enumerate(events)
            if before <= target or _in_pattern(readout.erc_drop, i, request[1], before, target)
        ][:target]
        told.dropped["erc"] += len(events) - len(good)
        passed += good
    return passed


def _in_pattern(drop: str, i: int, event: Event, before: int, target: int) -> bool:
    if drop == "time":
        return (i + 1) * target // before > i * target // before
    line = event.y if drop == "row" else event.x
    rank = int(f"{line % 32:05b}"[::-1], 2)
    return rank >= min(31, math.ceil(Fraction(32 * (before - target), before)))


def _linked(sensor: SensorParameters, passed: Requests, told: Told) -> Requests:
    """Return (time of its stamp, event) for each event that the link accepts."""
    readout = sensor.readout
    if not readout.link_rate:
        return passed
    step_ns = Fraction(10**9, readout.link_rate)
    leaving: list[Fraction] = []  # exact times at which accepted events leave
    busy_ns, count = Fraction(0), 0
    taken: Requests = []
    for ns, event in passed:
        free_ns = math.ceil(busy_ns + count * step_ns)
        if count == 0 or ns >= free_ns:
            busy_ns, count, free_ns = Fraction(ns), 0, ns
        elif sum(leaves > ns for leaves in leaving) >= readout.fifo:
            told.dropped["fifo"] += 1
            continue
        leaving.append(busy_ns + count * step_ns)
        count += 1
        taken.append((free_ns if readout.stamp == "sent" else ns, event))
    return taken


def _bits(key: int, counter: int) -> int:
    with np.errstate(over="ignore"):
        one = _hash(np.array([key % 2**64], np.uint64), np.array([counter % 2**64], np.uint64))
    return int(one[0])


def _normal(key: int, counter: int) -> float:
    first, second = (
        _uniform(np.array([_bits(key, counter + which)], np.uint64)) for which in (1, 2)
    )
    log = np.minimum(_log(first + 2.0**-53), 0.0)
    return float((np.sqrt(-2.0 * log) * _cos_turn(second))[0])


def _whole(ns: float) -> int:
    return max(0, math.floor(ns + 0.5))
