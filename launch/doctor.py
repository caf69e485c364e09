"""`evs doctor`: is this machine fit, and what to do if not."""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evs.drivers.checkup import Check

HELP = "is this machine fit: packages, processor, a trial run"

MARKS = {"ok": "ok  ", "note": "note", "bad": "BAD "}
"""verdict -> what stands before its line"""

FIT = "this machine is fit for evs"
UNFIT = "evs will not work here until what is BAD is mended"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.epilog = "Exit code 0: fit, 1: not. Nothing leaves this machine."
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")


def run(args: argparse.Namespace) -> int:
    """Look at everything; 0 if evs works here, 1 if not."""
    checks = []
    for check in examine():
        checks.append(check)
        if not args.json:
            print(_line(check), flush=True)
    fit = all(check.verdict != "bad" for check in checks)
    if args.json:
        plain = [dataclasses.asdict(check) for check in checks]
        print(json.dumps({"fit": fit, "checks": plain}, indent=2))
    else:
        print(FIT if fit else UNFIT)
    return 0 if fit else 1


def examine() -> Iterator[Check]:
    """Every check in turn, the quick ones first."""
    from evs.drivers import checkup

    yield checkup.check_python()
    yield checkup.check_platform()
    yield checkup.check_cores()
    yield checkup.check_memory()
    yield from checkup.check_packages()
    yield from checkup.check_extras()
    yield from checkup.guarded("native core", _again(), lambda: [checkup.check_core()])
    yield from checkup.check_disk(dict.fromkeys((Path.cwd(), Path(tempfile.gettempdir()))))
    yield from checkup.guarded("trial run", _again(), _trial)
    yield from checkup.guarded("timing", _again(), _timing)


def _again() -> str:
    return "mend what is marked BAD above; if nothing is, install evs again"


def _trial() -> list[Check]:
    from evs.drivers.checkup.trial import check_pipeline

    with tempfile.TemporaryDirectory() as folder:
        return check_pipeline(Path(folder))


def _timing() -> list[Check]:
    from evs.drivers.checkup.trial import check_timing

    return [check_timing()]


def _line(check: Check) -> str:
    fix = f"; {check.fix}" if check.fix else ""
    return f"{MARKS[check.verdict]} {check.name:14s} {check.says}{fix}"
