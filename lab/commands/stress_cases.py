"""The stress cases of `evs doctor`: run them, print them, write their table."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from evs_lab import stress
from evs_lab.stress import CaseResult
from evs_lab.stress.report import measured, write_table


def run_cases(show: bool) -> list[dict[str, Any]]:
    """Run the short form of all stress cases.

    Args:
        show: Print a line for each at once.

    Returns:
        Each result as JSON has it; `holds` is whether it keeps its bound.
    """
    return [_plain(result) for result in _results(short=True, show=show)]


def write(file: str) -> int:
    """Run all stress cases at full length and write their table; 0 if all keep their bounds."""
    from evs.drivers.run.report import check_targets

    check_targets([file])
    results = _results(short=False, show=True)
    write_table(file, results)
    holding = sum(one.holds for one in results)
    print(f"{holding} of {len(results)} extremes keep their bounds; the table is in {file}")
    return 0 if holding == len(results) else 1


def _results(short: bool, show: bool) -> list[CaseResult]:
    def line(result: CaseResult) -> None:
        mark = "ok  " if result.holds else "FAIL"
        print(f"{mark} {result.case.name:24s} {measured(result)}", flush=True)

    return stress.run_cases(short=short, on_done=line if show else None)


def _plain(result: CaseResult) -> dict[str, Any]:
    """A result as JSON."""
    case, measurement = result.case, result.measurement
    values = dataclasses.asdict(measurement) if measurement is not None else {}
    if values:
        # the key that readers of the JSON know
        values["said"] = values.pop("messages")
    return {
        "name": case.name,
        "group": case.group,
        "bound": case.bound,
        "holds": result.holds,
        "error": result.error,
        # JSON has no NaN
        **{
            k: str(v) if isinstance(v, float) and not math.isfinite(v) else v
            for k, v in values.items()
        },
    }
