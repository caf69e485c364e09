"""`evs loop NAME`: closed loops that show why, played, measured, filmed, or over the wire."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from evs.msgs import EvsError, unknown

if TYPE_CHECKING:
    from evs.drivers.loops.pencil.study import Plan

HELP = "closed loops that show why: a pencil balanced by what event cameras see"

LOOPS = ("pencil",)

EPILOG = """\
examples:
  evs loop pencil                                    balance for 30 s, in process
  evs loop pencil --gif pencil.gif                   the same, 4 s as a picture
  evs loop pencil --table out/pencil.json --jobs 2   events beside frames, to their limits
  evs launch pencil                                  world and controller, each in a process
--table writes FILE.json, which a second run goes on with, and the table beside it as FILE.md; with
--tracker of that tracker alone. With --quick it takes a minute, and its numbers mean nothing."""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs loop`."""
    parser.epilog = EPILOG
    add = parser.add_argument
    add("name", metavar="NAME", help="pencil")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--table", metavar="FILE.json", help="measure every tracker")
    what.add_argument("--gif", metavar="FILE.gif", help="film the event tracker")
    what.add_argument("--serve", metavar="ADDRESS", help="only the world: wait for a controller")
    what.add_argument("--connect", metavar="ADDRESS", help="only the controller of such a world")
    add("--tracker", metavar="NAME", help="events (default), 1000 FPS, 100 FPS, 60 FPS or 30 FPS")
    add("--seconds", type=float, metavar="S", help="how long it has to stand (30; --gif: 4)")
    add("--push", type=float, default=2.0, metavar="mNs", help="of the push of every second (2)")
    add("--delay", type=float, default=0.0, metavar="MS", help="until a force acts (0)")
    add("--length", type=float, default=0.2, metavar="M", help="of the stick (0.2)")
    add("--seed", type=int, default=0, metavar="N", help="start, pushes, noise (0)")
    add("--seeds", type=int, metavar="N", help="--table: trials of each value (4)")
    add("--jobs", type=int, default=1, metavar="N", help="--table: processes at work (1)")
    add("--quick", action="store_true", help="--table: a rehearsal")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def run(args: argparse.Namespace) -> int:
    """Play a loop; the exit code: 0, 1 where the stick fell."""
    if args.name not in LOOPS:
        raise unknown("loop", args.name, LOOPS)
    if args.table is not None:
        return _table(args)
    args.tracker = args.tracker or "events"
    if args.connect is not None:
        return _connect(args)
    if args.serve is not None:
        return _serve(args)
    return _play(args)


def _play(args: argparse.Namespace) -> int:
    # here, so that --help is quick
    from evs.drivers.loops.pencil.arena import Arena, Trial
    from evs.drivers.loops.pencil.film import film

    seconds = args.seconds if args.seconds is not None else (4.0 if args.gif else 30.0)
    if not seconds > 0.0:
        raise EvsError(f"--seconds is {seconds:g}: give a number over 0")
    trial = Trial(args.length, args.push, args.delay, seconds, args.seed)
    if args.gif is not None:
        outcome = film(Path(args.gif), trial, args.tracker)
    else:
        outcome = Arena(args.tracker, trial.length_m, trial.delay_ms).play(trial)
    if not args.quiet:
        what = "fell after" if outcome.fallen else "stood for"
        print(
            f"{args.tracker}: {what} {outcome.stood_s:g} s, {outcome.sway_mm:.1f} mm of sway (rms)"
        )
    return int(outcome.fallen)


def _table(args: argparse.Namespace) -> int:
    from evs.drivers.loops.pencil.study import Plan, count_units, plain_plan, run_study
    from evs.drivers.loops.pencil.table import HEADINGS, markdown, table_rows
    from evs.drivers.loops.results import Results
    from evs.drivers.pipeline.report import check_targets, write_whole
    from evs.launch import terminal

    plan, file = _plan(args), Path(args.table)
    if file.suffix != ".json":
        raise EvsError(f"--table is '{file}': end it in .json")
    page = file.with_suffix(".md")
    check_targets([file, page])
    results = Results(file, plain_plan(plan))
    known = sum(len(results.rows.get(tracker, {})) for tracker in plan.trackers)
    with terminal.bar("measuring", count_units(plan), args.quiet) as moved:
        for done, unit in enumerate(run_study(plan, results, args.jobs), known + 1):
            moved(done, f"{unit.tracker}: {unit.what}")
    command = f"evs loop pencil --table {file}" + (" --quick" if args.quick else "")
    shown = [tracker for tracker in Plan().trackers if tracker in results.rows]
    write_whole(markdown(results.rows, shown, command), page)
    if not args.quiet:
        terminal.table("pencil", HEADINGS, table_rows(results.rows, shown))
    return 0


def _plan(args: argparse.Namespace) -> Plan:
    from evs.drivers.loops.pencil.arena import TRACKERS
    from evs.drivers.loops.pencil.study import QUICK, Plan

    plan = QUICK if args.quick else Plan()
    if args.tracker is not None:
        if args.tracker not in TRACKERS:
            raise unknown("tracker", args.tracker, TRACKERS)
        plan = replace(plan, trackers=(args.tracker,))
    if args.seeds is None:
        return plan
    if args.seeds < 1:
        raise EvsError(f"--seeds is {args.seeds}: give 1 or more")
    return replace(plan, seeds=args.seeds)


def _serve(args: argparse.Namespace) -> int:
    from evs.drivers.lockstep import LockstepServer
    from evs.drivers.loops.pencil.arena import TRACKERS, PencilLoop
    from evs.drivers.pipeline.stopping import stop_signals

    if args.tracker not in TRACKERS:
        raise unknown("tracker", args.tracker, TRACKERS)
    loop = PencilLoop(
        TRACKERS[args.tracker],
        args.length,
        push_mns=args.push,
        delay_ms=args.delay,
        max_s=args.seconds if args.seconds is not None else 30.0,
    )
    server = LockstepServer(loop, args.serve)
    server.open()
    try:
        if not args.quiet:
            print(f"a pencil at {server.address}", flush=True)
        with stop_signals() as stopped:
            server.serve(stopped)
    finally:
        server.close()
    return 0


def _connect(args: argparse.Namespace) -> int:
    from evs.drivers.lockstep import connect
    from evs.drivers.loops.pencil.controller import Controller, EventTracker, FrameTracker

    tracker = EventTracker(args.length) if args.tracker == "events" else FrameTracker()
    controller = Controller(tracker, args.length)
    with connect(args.connect, "pencil") as loop:
        seen = loop.reset(args.seed)
        while not seen.done:
            seen = loop.step(controller.decide(seen))
    if not args.quiet:
        print(f"{seen.t_us / 1e6:g} s: {seen.done}")
    return int("left" in seen.done)
