"""`evs loop NAME --table`: measure every tracker, into a file that a second run continues."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from evs.msgs import EvsError


def pencil(args: argparse.Namespace) -> int:
    """Tune every tracker and find its limits."""
    # here, so that --help is quick
    from evs.drivers.run.report import check_targets, write_whole
    from evs.examples.common.results_file import ResultsFile
    from evs.examples.pencil import TRACKERS
    from evs.examples.pencil.study import QUICK, StudyPlan, count_units, plain_plan, run_study
    from evs.examples.pencil.study_report import HEADINGS, markdown, table_rows
    from evs.launch.support import terminal

    plan = QUICK if args.quick else StudyPlan()
    if args.tracker is not None:
        plan = replace(plan, trackers=(args.tracker,))
    if args.seeds is not None:
        plan = replace(plan, seeds=_seeds(args))
    file, page = _targets(args)
    check_targets([file, page])
    results = ResultsFile(file, plain_plan(plan))
    known = sum(len(results.rows.get(tracker, {})) for tracker in plan.trackers)
    with terminal.bar("measuring", count_units(plan), args.quiet) as moved:
        for done, unit in enumerate(run_study(plan, results, args.jobs), known + 1):
            moved(done, f"{unit.tracker}: {unit.what}")
    shown = [tracker for tracker in TRACKERS if tracker in results.rows]
    write_whole(markdown(results.rows, shown, _command(args)), page)
    if not args.quiet:
        terminal.table("pencil", HEADINGS, table_rows(results.rows, shown))
    return 0


def goalie(args: argparse.Namespace) -> int:
    """Shoot at every tracker, over all speeds."""
    from evs.drivers.pictures import write_png
    from evs.drivers.run.report import check_targets, write_whole
    from evs.examples.common.results_file import ResultsFile
    from evs.examples.goalie.curve_report import HEADINGS, chart, markdown, table_rows
    from evs.examples.goalie.speed_curve import QUICK, CurvePlan, count_units, plain_plan, run_curve
    from evs.launch.support import terminal

    plan = QUICK if args.quick else CurvePlan()
    if args.tracker is not None:
        plan = replace(plan, trackers=(args.tracker,))
    if args.seeds is not None:
        plan = replace(plan, shots=_seeds(args))
    file, page = _targets(args)
    picture = file.with_suffix(".png")
    check_targets([file, page, picture])
    results = ResultsFile(file, plain_plan(plan))
    known = sum(len(results.rows.get(tracker, {})) for tracker in plan.trackers)
    with terminal.bar("shooting", count_units(plan), args.quiet) as moved:
        for done, unit in enumerate(run_curve(plan, results, args.jobs), known + 1):
            moved(done, f"{unit.tracker}: {unit.speed_m_s:g} m/s")
    write_whole(markdown(results.rows, plan.shots, _command(args)), page)
    write_png(picture, chart(results.rows, plan.shots), few_colours=True)
    if not args.quiet:
        terminal.table("goalie", HEADINGS, table_rows(results.rows, plan.shots))
    return 0


def _seeds(args: argparse.Namespace) -> int:
    if args.seeds < 1:
        raise EvsError(f"--seeds is {args.seeds}: give 1 or more")
    return int(args.seeds)


def _targets(args: argparse.Namespace) -> tuple[Path, Path]:
    """The results and the page."""
    file = Path(args.table)
    if file.suffix != ".json":
        raise EvsError(f"--table is '{file}': end it in .json")
    return file, file.with_suffix(".md")


def _command(args: argparse.Namespace) -> str:
    words = ["evs loop", args.name, "--table", args.table]
    words += [] if args.seeds is None else ["--seeds", str(args.seeds)]
    return " ".join([*words, *(["--quick"] if args.quick else [])])
