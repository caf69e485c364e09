"""`evs loop NAME`: run an example of a closed loop, measure it, film it, or serve it."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support import options
from evs.msgs import EvsError, unknown

if TYPE_CHECKING:
    from evs.emulator.base.protocols import Meter
    from evs.emulator.simulation.closed_loop import ClosedLoop
    from evs.examples.cartpole.controller import CartPoleController
    from evs.examples.goalie.controller import Goalkeeper
    from evs.examples.pencil.controller import Controller

LOOPS = ("pencil", "goalie", "cartpole")

WORLD: dict[str, dict[str, float | None]] = {
    "seconds": {"pencil": None, "cartpole": None},
    "push": {"pencil": 2.0, "cartpole": 3000.0},
    "delay": {"pencil": 0.0, "cartpole": 0.0},
    "length": {"pencil": 0.2},
    "speed": {"goalie": 5.0},
}
"""option -> the loops that have it, with its default"""

SERVED = (
    *("record", "overwrite", "beside", "publish", "sink", "worker", "report"),
    *("lockstep", "pace", "realtime"),
)
"""keys of a pipeline that --serve accepts, by their first part"""

ITS_OWN = ("lockstep.address", "lockstep.cameras")
"""exceptions, which --serve sets itself"""

EPILOG = """\
examples:
  evs loop pencil                                    balance for 30 s, in process
  evs loop pencil --gif pencil.gif                   the same, 4 s as a film
  evs loop pencil --table out/pencil.json --jobs 2   compare events and frames up to their limits
  evs loop goalie --gif goalie.gif --speed 8         four shots, in slow motion
  evs loop goalie --table out/goalie.json            saves against ball speed, also as .md and .png
  evs loop cartpole --seeds 20                       gymnasium's cart-pole, its camera on the cart
  evs launch pencil                                  world and controller in two processes
  evs loop pencil --serve tcp://127.0.0.1:5570 publish=tcp://127.0.0.1:5560 record=run.aedat4
--table writes FILE.json, which a second run resumes, and the table as FILE.md next to it. With
--tracker it measures only that tracker. --quick takes a minute, and its numbers are meaningless."""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs loop`."""
    parser.epilog = EPILOG
    add = parser.add_argument
    add("name", metavar="NAME", help="pencil, goalie or cartpole")
    add(
        "words", metavar="key=value", nargs="*", help="--serve: publish=, record=, sink.0.type= ..."
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--table", metavar="FILE.json", help="measure every tracker")
    what.add_argument("--gif", metavar="FILE.gif", help="make a film")
    what.add_argument(
        "--serve", metavar="ADDRESS", help="run only the world, and wait for a controller"
    )
    what.add_argument(
        "--connect", metavar="ADDRESS", help="run only the controller of such a world"
    )
    add("--tracker", metavar="NAME", help="events (default), or frames: 60 FPS, 200 FPS ...")
    add(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="random seed of start, pushes, shots and noise (0)",
    )
    add("--seconds", type=float, metavar="S", help="time to stay upright (30; cartpole: 10)")
    add("--push", type=float, metavar="mNs", help="strength of a push (pencil: 2, cartpole: 3000)")
    add("--delay", type=float, metavar="MS", help="delay until a force acts (0)")
    add("--length", type=float, metavar="M", help="pencil: length of the stick (0.2)")
    add("--speed", type=float, metavar="M/S", help="goalie: speed of the ball (5)")
    add("--seeds", type=int, metavar="N", help="cartpole, --table: number of trials")
    add("--jobs", type=int, metavar="N", help="--table: parallel processes (1)")
    add("--quick", action="store_true", help="--table: a quick trial run")
    options.add_key_options(parser)
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def run(args: argparse.Namespace) -> int:
    """Run a loop; the exit code: 0, or 1 if the stick fell or the ball went in."""
    if args.name not in LOOPS:
        raise unknown("loop", args.name, LOOPS)
    if args.seed < 0:
        raise EvsError(f"--seed is {args.seed}: give 0 or more")
    _check(args)
    if args.table is not None:
        measure = _measure_pencil if args.name == "pencil" else _measure_goalie
        return measure(args)
    args.tracker = args.tracker or "events"
    if args.connect is not None:
        return _connect(args)
    if args.serve is not None:
        return _serve(args)
    play = {"pencil": _pencil, "goalie": _goalie, "cartpole": _cartpole}[args.name]
    return play(args)


def _check(args: argparse.Namespace) -> None:
    """Refuse options that would have no effect or are impossible; then set the defaults."""
    if args.words and args.serve is None:
        raise EvsError(f"'{args.words[0]}' is for --serve ADDRESS only")
    if args.connect is None and (args.server_key or args.key):
        raise EvsError(
            "--server-key and --key are for --connect ADDRESS (--serve: lockstep.key=FILE)"
        )
    if args.table is not None and args.name == "cartpole":
        raise EvsError("the cart-pole has no --table: give --seeds")
    if args.table is None:
        for option in ("jobs", "quick", *(() if args.name == "cartpole" else ("seeds",))):
            if getattr(args, option):
                raise EvsError(f"--{option} is for --table FILE.json only")
    for option, defaults in WORLD.items():
        value = getattr(args, option)
        if value is None:
            setattr(args, option, defaults.get(args.name))
        elif args.name not in defaults:
            raise EvsError(f"--{option} is for {' and '.join(defaults)}, not for the {args.name}")
        elif not math.isfinite(value):
            raise EvsError(f"--{option} is {value}: give a finite number")
    args.jobs = 1 if args.jobs is None else args.jobs
    if args.tracker is not None:
        _check_tracker(args)


def _check_tracker(args: argparse.Namespace) -> None:
    # here, so that --help is quick
    from evs.examples import cartpole, goalie, pencil

    known = {"pencil": pencil, "goalie": goalie, "cartpole": cartpole}[args.name].TRACKERS
    if args.tracker not in known:
        raise unknown("tracker", args.tracker, known)


def _pencil(args: argparse.Namespace) -> int:
    from evs.examples.pencil.environment import PencilExperiment, PencilTrial
    from evs.examples.pencil.gif import record_gif

    seconds = _seconds(args, 4.0 if args.gif else 30.0)
    trial = PencilTrial(args.length, args.push, args.delay, seconds, args.seed)
    if args.gif is not None:
        outcome = record_gif(Path(args.gif), trial, args.tracker)
    else:
        outcome = PencilExperiment(args.tracker, trial.length_m, trial.delay_ms).play(trial)
    if not args.quiet:
        what = "fell after" if outcome.fallen else "stood for"
        print(f"{args.tracker}: {what} {outcome.stood_s:g} s, sway {outcome.sway_mm:.1f} mm rms")
    return int(outcome.fallen)


def _goalie(args: argparse.Namespace) -> int:
    from evs.examples.goalie.environment import SAVES_M, GoalieExperiment
    from evs.examples.goalie.gif import SHOTS, record_gif

    if args.gif is not None:
        saved = record_gif(Path(args.gif), args.speed, args.tracker, args.seed)
        if not args.quiet:
            print(f"{args.tracker}: {saved} of {SHOTS} saved at {args.speed:g} m/s")
        return int(saved < SHOTS)
    miss_m = GoalieExperiment(args.tracker).shoot(args.speed, args.seed)
    if not args.quiet:
        what = "saved" if miss_m <= SAVES_M else "goal"
        print(f"{args.tracker}: {what}, {1e3 * miss_m:.0f} mm from the middle of the paddle")
    return int(miss_m > SAVES_M)


def _cartpole(args: argparse.Namespace) -> int:
    from evs.examples.cartpole.environment import CartPoleLoop, CartPoleTrial, play
    from evs.examples.cartpole.gif import record_gif

    seconds = _seconds(args, 4.0 if args.gif else 10.0)
    count = 1 if args.seeds is None else args.seeds
    if count < 1:
        raise EvsError(f"--seeds is {count}: give 1 or more")
    trials = [
        CartPoleTrial(args.seed + number, args.push * 1e-3, args.delay, seconds)
        for number in range(count)
    ]
    if args.gif is not None:
        outcomes = [record_gif(Path(args.gif), trials[0])]
    else:
        loop = CartPoleLoop(delay_ms=args.delay)
        outcomes = [play(loop, trial) for trial in trials]
    stood = sum(not outcome.ended for outcome in outcomes)
    if not args.quiet:
        lean = max(outcome.lean_rad for outcome in outcomes)
        print(f"{stood} of {len(outcomes)} stood for {seconds:g} s, {lean:.3f} rad rms at most")
        for trial, outcome in zip(trials, outcomes, strict=False):
            if outcome.ended:
                print(f"seed {trial.seed}: {outcome.stood_s:g} s, {outcome.ended}")
    return int(stood < len(outcomes))


def _measure_pencil(args: argparse.Namespace) -> int:
    """Tune every tracker and find its limits."""
    # here, so that --help is quick
    from evs.drivers.run.report import check_targets, write_whole
    from evs.examples.common.results_file import ResultsFile
    from evs.examples.pencil import TRACKERS
    from evs.examples.pencil.study import (
        HEADINGS,
        QUICK,
        StudyPlan,
        count_units,
        markdown,
        plain_plan,
        run_study,
        table_rows,
    )
    from evs.launch.support import terminal

    plan = QUICK if args.quick else StudyPlan()
    if args.tracker is not None:
        plan = replace(plan, trackers=(args.tracker,))
    if args.seeds is not None:
        plan = replace(plan, seeds=_number_of_seeds(args))
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


def _measure_goalie(args: argparse.Namespace) -> int:
    """Shoot at every tracker, over all speeds."""
    from evs.drivers.pictures import write_png
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets, write_whole
    from evs.examples.common.results_file import ResultsFile
    from evs.examples.goalie.speed_curve import (
        HEADINGS,
        QUICK,
        CurvePlan,
        chart,
        count_units,
        markdown,
        plain_plan,
        run_curve,
        table_rows,
    )
    from evs.launch.support import terminal

    plan = QUICK if args.quick else CurvePlan()
    if args.tracker is not None:
        plan = replace(plan, trackers=(args.tracker,))
    if args.seeds is not None:
        plan = replace(plan, shots=_number_of_seeds(args))
    file, page = _targets(args)
    picture = file.with_suffix(".png")
    check_chart_file(picture)
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


def _number_of_seeds(args: argparse.Namespace) -> int:
    if args.seeds < 1:
        raise EvsError(f"--seeds is {args.seeds}: give 1 or more")
    return int(args.seeds)


def _targets(args: argparse.Namespace) -> tuple[Path, Path]:
    """The files of the results and of the page."""
    file = Path(args.table)
    if file.suffix != ".json":
        raise EvsError(f"--table is '{file}': end it in .json")
    return file, file.with_suffix(".md")


def _command(args: argparse.Namespace) -> str:
    words = ["evs loop", args.name, "--table", args.table]
    words += [] if args.seeds is None else ["--seeds", str(args.seeds)]
    return " ".join([*words, *(["--quick"] if args.quick else [])])


def _serve(args: argparse.Namespace) -> int:
    """Serve the world until it is stopped; return the exit code."""
    # here, so that --help is quick
    from evs.drivers.run import config as pipeline
    from evs.emulator.config import decoding
    from evs.examples.cartpole.environment import SCENE as CARTPOLE
    from evs.examples.goalie.environment import SCENE as GOALIE
    from evs.examples.pencil.environment import SCENE as PENCIL
    from evs.launch.support import serve_loop

    keys = [decoding.split_word(word) for word in args.words]
    for key, _ in keys:
        if key.partition(".")[0].partition("_")[0] not in SERVED or key in ITS_OWN:
            raise EvsError(
                f"{key} is not for --serve, whose loop is made by options (evs loop --help); "
                f"what begins with {', '.join(SERVED)} is"
            )
    scene = {"pencil": PENCIL, "goalie": GOALIE, "cartpole": CARTPOLE}[args.name]
    own = [("pace", "lockstep"), ("scene.file", str(scene)), ("lockstep.address", args.serve)]
    config = pipeline.load(None, [*own, *keys])
    world = {name: getattr(args, name) for name, loops in WORLD.items() if args.name in loops}
    reported = {"loop": args.name, "tracker": args.tracker, **world, "keys": dict(keys)}
    return serve_loop.serve(config, args.quiet, lambda meter: _loop(args, meter), reported)


def _loop(args: argparse.Namespace, meter: Meter) -> ClosedLoop:
    from evs.examples import goalie, pencil

    if args.name == "goalie":
        from evs.examples.goalie.environment import GoalieLoop

        return GoalieLoop(goalie.TRACKERS[args.tracker], speed_m_s=args.speed, meter=meter)
    if args.name == "cartpole":
        from evs.examples.cartpole.environment import CartPoleLoop

        return CartPoleLoop(
            push_ns=args.push * 1e-3,
            delay_ms=args.delay,
            max_s=_seconds(args, 10.0),
            meter=meter,
        )
    from evs.examples.pencil.environment import PencilLoop

    return PencilLoop(
        pencil.TRACKERS[args.tracker],
        args.length,
        push_mns=args.push,
        delay_ms=args.delay,
        max_s=_seconds(args, 30.0),
        meter=meter,
    )


def _connect(args: argparse.Namespace) -> int:
    """Run a controller, in a process that imports no simulator; 1 if the loop ended early."""
    from evs.drivers import lockstep

    controller = _controller(args)
    keys = {"server_key": args.server_key, "key": args.key}
    with lockstep.connect(args.connect, args.name, **keys) as loop:
        observation = loop.reset(args.seed)
        while not observation.done:
            observation = loop.step(controller.decide(observation))
    if not args.quiet:
        print(f"{observation.t_us / 1e6:g} s: {observation.done}")
    return int(args.name != "goalie" and not observation.done.endswith("are over"))


def _controller(args: argparse.Namespace) -> Controller | Goalkeeper | CartPoleController:
    from evs.examples import goalie, pencil

    if args.name == "goalie":
        from evs.examples.goalie.controller import Goalkeeper

        return Goalkeeper(frames=goalie.TRACKERS[args.tracker] > 0)
    if args.name == "cartpole":
        from evs.examples.cartpole.controller import CartPoleController

        return CartPoleController()
    from evs.examples.pencil.controller import Controller, make_tracker

    return Controller(make_tracker(pencil.TRACKERS[args.tracker], args.length), args.length)


def _seconds(args: argparse.Namespace, default: float) -> float:
    """How long the stick has to stand."""
    seconds = default if args.seconds is None else float(args.seconds)
    if not seconds > 0.0:
        raise EvsError(f"--seconds is {seconds:g}: give a number over 0")
    return seconds
