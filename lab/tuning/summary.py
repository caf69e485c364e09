"""Describe the result of tuning: lines for the terminal and the head of the file."""

from __future__ import annotations

import math

from evs_lab.sweep.pareto_front import ErrorMetric
from evs_lab.tuning.search import CandidateResult, SearchResult
from evs_lab.tuning.space import BASE_TICK_US


def facts(
    found: SearchResult, metric: ErrorMetric, reference_error: float, seconds: float
) -> list[tuple[str, str]]:
    """(name, what) of each line."""
    winner = found.winner
    lines = [
        ("goal", f"{found.goal}; {'reached' if found.reached else 'NOT reached'}"),
        ("found", str(winner.candidate)),
        ("real-time factor", _both(winner.rtf, winner.predicted_rtf)),
        ("error", f"{_both(winner.error, winner.predicted_error)}; {metric.label}"),
        (
            "reference's own",
            f"{reference_error:.3g}: less cannot be seen"
            if reference_error
            else "none can be seen",
        ),
        ("less error", _step(found.better, winner)),
        ("more speed", _step(found.faster, winner)),
    ]
    wrong = worst_miss(found)
    several = "s" if len(found.measured) > 1 else ""
    count = f"{len(found.measured)} configuration{several} in {seconds:.0f} s"
    lines.append(("measured", f"{count}{wrong}"))
    tick_us = winner.candidate.tick_us
    if tick_us > BASE_TICK_US:
        lines.append(
            (
                "tick",
                f"{tick_us / 1000:g} ms, so events come that late: scene.tick_us=1000 keeps 1 ms",
            )
        )
    if not found.verified:
        lines.append(
            ("not verified", "a better one is predicted, but --budget ended before it was measured")
        )
    return lines


def _both(measured: float, predicted: float) -> str:
    text = f"{measured:.3g} measured"
    return text if math.isnan(predicted) else f"{text} ({predicted:.3g} predicted)"


def _step(one: CandidateResult | None, winner: CandidateResult) -> str:
    """Cost of the next better or faster configuration."""
    if one is None:
        return "none of those that can be tuned"
    how = "measured" if one.measured else "predicted"
    slower = one.rtf / winner.rtf
    off = one.error / winner.error
    return (
        f"{one.candidate}: error {one.error:.3g} ({off:.2g} of this), real-time factor "
        f"{one.rtf:.3g} ({slower:.2g} of this), {how}"
    )


def worst_miss(found: SearchResult) -> str:
    """Error of the worst prediction that was followed by a measurement."""
    ratios = [
        max(a / b, b / a)
        for one in found.measured
        for a, b in ((one.rtf, one.predicted_rtf), (one.error, one.predicted_error))
        if not math.isnan(b)
    ]
    if not ratios:
        return "; no prediction was put to the test"
    return f"; predictions were wrong by at most {100 * (max(ratios) - 1):.0f} %"


def table(found: SearchResult) -> list[tuple[str, str, str, str, str]]:
    """Every measurement: configuration, real-time factor, predicted, error, predicted."""

    def text(value: float) -> str:
        return "-" if math.isnan(value) else f"{value:.3g}"

    return [
        (str(m.candidate), text(m.rtf), text(m.predicted_rtf), text(m.error),
         text(m.predicted_error))
        for m in found.measured
    ]  # fmt: skip
