"""`evs loop NAME`: run an example of a closed loop, measure it, film it, or serve it."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from evs.launch.support import loop_tables, loop_wire, pipeline_options
from evs.msgs import EvsError, unknown

HELP = "closed-loop examples: balance a pencil, keep a goal, by event cameras"

LOOPS = ("pencil", "goalie", "cartpole")

EPILOG = """\
examples:
  evs loop pencil                                    balance for 30 s, in process
  evs loop pencil --gif pencil.gif                   the same, 4 s as a film
  evs loop pencil --table out/pencil.json --jobs 2   compare events with frames, up to their limits
  evs loop goalie --gif goalie.gif --speed 8         four shots, in slow motion
  evs loop goalie --table out/goalie.json            saves against ball speed, also as .md and .png
  evs loop cartpole --seeds 20                       gymnasium's cart-pole, its camera on the cart
  evs launch pencil                                  world and controller in two processes
  evs loop pencil --serve tcp://127.0.0.1:5570 publish=tcp://127.0.0.1:5560 record=run.aedat4
--table writes FILE.json, which a second run resumes, and the table as FILE.md beside it. With
--tracker it measures only that tracker. --quick takes a minute, and its numbers mean nothing."""


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
    pipeline_options.add_key_options(parser)
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def run(args: argparse.Namespace) -> int:
    """Play a loop; the exit code: 0, 1 where the stick fell or the ball went in."""
    if args.name not in LOOPS:
        raise unknown("loop", args.name, LOOPS)
    if args.seed < 0:
        raise EvsError(f"--seed is {args.seed}: give 0 or more")
    _check(args)
    if args.table is not None:
        table = loop_tables.pencil if args.name == "pencil" else loop_tables.goalie
        return table(args)
    args.tracker = args.tracker or "events"
    if args.connect is not None:
        return loop_wire.connect(args)
    if args.serve is not None:
        return loop_wire.serve(args)
    play = {"pencil": _pencil, "goalie": _goalie, "cartpole": _cartpole}[args.name]
    return play(args)


def _check(args: argparse.Namespace) -> None:
    """Refuse what would change nothing here, or cannot be; then set what is not given."""
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
    for option, defaults in loop_wire.WORLD.items():
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

    seconds = loop_wire.seconds(args, 4.0 if args.gif else 30.0)
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

    seconds = loop_wire.seconds(args, 4.0 if args.gif else 10.0)
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
