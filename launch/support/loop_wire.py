"""`evs loop NAME --serve` and `--connect`: world and controller in separate processes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.emulator.base.protocols import Meter
    from evs.emulator.simulation.closed_loop import Loop
    from evs.examples.cartpole.controller import CartPoleController
    from evs.examples.goalie.controller import Goalkeeper
    from evs.examples.pencil.controller import Controller

WORLD: dict[str, dict[str, float | None]] = {
    "seconds": {"pencil": None, "cartpole": None},
    "push": {"pencil": 2.0, "cartpole": 3000.0},
    "delay": {"pencil": 0.0, "cartpole": 0.0},
    "length": {"pencil": 0.2},
    "speed": {"goalie": 5.0},
}
"""option -> the loops that it is for, and what it is there where it is not given"""

SERVED = (
    *("record", "overwrite", "beside", "publish", "sink", "aside", "worker", "report"),
    *("lockstep", "pace", "realtime"),
)
"""keys of a pipeline that --serve takes, by how they begin"""

ITS_OWN = ("lockstep.address", "lockstep.cameras")
"""but for these"""


def serve(args: argparse.Namespace) -> int:
    """Serve the world until it is stopped; return the exit code."""
    # here, so that --help is quick
    from evs.drivers import settings
    from evs.drivers.run import config as pipeline
    from evs.examples.cartpole.environment import SCENE as CARTPOLE
    from evs.examples.goalie.environment import SCENE as GOALIE
    from evs.examples.pencil.environment import SCENE as PENCIL
    from evs.launch.support import serve_loop

    keys = [settings.split_word(word) for word in args.words]
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


def _loop(args: argparse.Namespace, meter: Meter) -> Loop:
    from evs.examples import goalie, pencil

    if args.name == "goalie":
        from evs.examples.goalie.environment import GoalieLoop

        return GoalieLoop(goalie.TRACKERS[args.tracker], speed_m_s=args.speed, meter=meter)
    if args.name == "cartpole":
        from evs.examples.cartpole.environment import CartPoleLoop

        return CartPoleLoop(
            push_ns=args.push * 1e-3,
            delay_ms=args.delay,
            max_s=seconds(args, 10.0),
            meter=meter,
        )
    from evs.examples.pencil.environment import PencilLoop

    return PencilLoop(
        pencil.TRACKERS[args.tracker],
        args.length,
        push_mns=args.push,
        delay_ms=args.delay,
        max_s=seconds(args, 30.0),
        meter=meter,
    )


def connect(args: argparse.Namespace) -> int:
    """A controller, in a process that imports no simulator; 1 where it ended before its time."""
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


def seconds(args: argparse.Namespace, default: float) -> float:
    """How long it has to stand."""
    seconds = default if args.seconds is None else float(args.seconds)
    if not seconds > 0.0:
        raise EvsError(f"--seconds is {seconds:g}: give a number over 0")
    return seconds
