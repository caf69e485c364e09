"""`evs doctor`: is this machine fit, what breaks evs on it, and what to do about that."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.tools.doctor import Check
    from evs.tools.stress import Tried

HELP = "is this machine fit: packages, processor, a trial run, and the extremes"

MARKS = {"ok": "ok  ", "note": "note", "bad": "BAD "}
"""verdict -> what stands before its line"""

FIT = "this machine is fit for evs"
UNFIT = "evs will not work here until what is BAD is mended"
BROKEN = (
    "FAIL: evs does not keep its bounds here; run `evs doctor --json` and report what it prints as "
    "an issue"
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.epilog = "Exit code 0: fit, 1: not. Nothing leaves this machine."
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    parser.add_argument(
        "--quick", action="store_true", help="leave out the extremes, which take most of a minute"
    )
    parser.add_argument(
        "--markdown",
        metavar="FILE",
        help="the extremes alone, at full length (some minutes), as a table in this file",
    )


def run(args: argparse.Namespace) -> int:
    """Look at everything; 0 if evs works here and keeps its bounds, 1 if not."""
    if args.markdown:
        return _write(args.markdown)
    checks = []
    for check in examine():
        checks.append(check)
        if not args.json:
            print(_line(check), flush=True)
    fit = all(check.verdict != "bad" for check in checks)
    # what does not work at all need not be tried hard
    tried = _extremes(short=True, loud=not args.json) if fit and not args.quick else []
    holds = all(one.holds for one in tried)
    if args.json:
        plain = [dataclasses.asdict(check) for check in checks]
        told = {"fit": fit, "checks": plain, "extremes": [_plain(one) for one in tried]}
        print(json.dumps(told, indent=2))
    else:
        print(FIT if fit and holds else BROKEN if fit else UNFIT)
    return 0 if fit and holds else 1


def _write(file: str) -> int:
    from evs.drivers.run.report import check_targets
    from evs.tools.stress.report import write_table

    check_targets([file])
    tried = _extremes(short=False, loud=True)
    write_table(file, tried)
    kept = sum(one.holds for one in tried)
    print(f"{kept} of {len(tried)} extremes keep their bounds; the table is in {file}")
    return 0 if kept == len(tried) else 1


def _extremes(short: bool, loud: bool) -> list[Tried]:
    """Try all of them; loud: a line for each as it is done."""
    from evs.tools.stress import run_extremes
    from evs.tools.stress.report import measured

    def show(tried: Tried) -> None:
        mark = "ok  " if tried.holds else "FAIL"
        print(f"{mark} {tried.extreme.name:24s} {measured(tried)}", flush=True)

    return run_extremes(short=short, on_done=show if loud else None)


def _plain(tried: Tried) -> dict[str, Any]:
    extreme, outcome = tried.extreme, tried.outcome
    told = dataclasses.asdict(outcome) if outcome is not None else {}
    return {
        "name": extreme.name,
        "group": extreme.group,
        "bound": extreme.bound,
        "holds": tried.holds,
        "error": tried.error,
        # JSON has no NaN
        **{
            k: str(v) if isinstance(v, float) and not math.isfinite(v) else v
            for k, v in told.items()
        },
    }


def examine() -> Iterator[Check]:
    """Every check in turn, the quick ones first."""
    from evs.tools import doctor

    yield doctor.check_python()
    yield doctor.check_platform()
    yield doctor.check_cores()
    yield doctor.check_memory()
    yield from doctor.check_packages()
    yield from doctor.check_extras()
    yield from doctor.guarded("native core", _again(), lambda: [doctor.check_core()])
    yield from doctor.check_disk(dict.fromkeys((Path.cwd(), Path(tempfile.gettempdir()))))
    yield from doctor.guarded("trial run", _again(), _trial)
    yield from doctor.guarded("timing", _again(), _timing)


def _again() -> str:
    return "mend what is marked BAD above; if nothing is, install evs again"


def _trial() -> list[Check]:
    from evs.tools.doctor.trial import check_pipeline

    with tempfile.TemporaryDirectory() as folder:
        return check_pipeline(Path(folder))


def _timing() -> list[Check]:
    from evs.tools.doctor.trial import check_timing

    return [check_timing()]


def _line(check: Check) -> str:
    fix = f"; {check.fix}" if check.fix else ""
    return f"{MARKS[check.verdict]} {check.name:14s} {check.says}{fix}"
