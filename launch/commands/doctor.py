"""`evs doctor`: check this machine, run the stress cases of evs-lab, and say how to fix faults."""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support import plugins

if TYPE_CHECKING:
    from evs.drivers.run.stop_signals import Ending
    from evs.tools.doctor import Check

MARKS = {"ok": "ok  ", "note": "note", "bad": "BAD "}
"""verdict -> prefix of its line"""

FIT = "this machine is fit for evs"
UNFIT = "evs will not work here until what is BAD is mended"
BROKEN = (
    "FAIL: evs does not keep its bounds here; run `evs doctor --json` and report what it prints as "
    "an issue"
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.epilog = "Exit code 0: evs works here, 1: it does not. No data leaves this machine."
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="skip the stress cases of evs-lab, which take most of a minute",
    )
    parser.add_argument(
        "--markdown",
        metavar="FILE",
        help="only run the stress cases of evs-lab, at full length (several minutes), and write a "
        "table to FILE",
    )


def run(args: argparse.Namespace) -> int:
    """Run all checks; 0 if evs works here and keeps its bounds, 1 if not."""
    from evs.drivers.run.stop_signals import ending_signals

    with ending_signals() as ending:
        if not args.markdown:
            return _check(args, ending)
        cases = plugins.stress_cases()
        if cases is None:
            raise plugins.not_installed("the table of stress cases")
        return int(cases.write(args.markdown))


def _check(args: argparse.Namespace, ending: Ending) -> int:
    """Print every check, then the stress cases."""
    checks = []
    for check in examine():
        ending.check()
        checks.append(check)
        if not args.json:
            print(_line(check), flush=True)
    fit = all(check.verdict != "bad" for check in checks)
    # stress cases only if everything else works
    cases = plugins.stress_cases() if fit and not args.quick else None
    results = [] if cases is None else cases.run_cases(show=not args.json)
    holds = all(one["holds"] for one in results)
    if args.json:
        plain = [dataclasses.asdict(check) for check in checks]
        report = {"fit": fit, "checks": plain, "extremes": results}
        print(json.dumps(report, indent=2))
    else:
        print(FIT if fit and holds else BROKEN if fit else UNFIT)
    return 0 if fit and holds else 1


def examine() -> Iterator[Check]:
    """Yield every check, the quick ones first."""
    from evs.tools import doctor

    yield doctor.check_python()
    yield doctor.check_platform()
    yield doctor.check_cores()
    yield doctor.check_memory()
    yield from doctor.check_packages()
    yield from doctor.check_extras()
    yield from doctor.guarded("gpu", "take render.device=cpu", lambda: [doctor.check_gpu()])
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
