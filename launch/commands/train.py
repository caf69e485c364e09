"""`evs train`: make training data, and train the network."""

from __future__ import annotations

import argparse
from pathlib import Path

from evs.launch.support import train_fit
from evs.msgs import EvsError
from evs.tools.training.settings import DataSettings

HELP = "train the network: `data` makes scenes and their light, `fit` learns from them"

SUBCOMMANDS = True
"""The first word says what is done; options follow it."""

EXAMPLES = """\
examples:
  evs train data out/data                                  200 scenes of 2048 pixels, seed 1
  evs train data out/small --scenes 20 --pixels 256 --truth-spp 128
  evs train data out/data --workers 2                      two scenes at once; the same bytes
  evs train data out/data --ray auto                       on the Ray cluster of this machine
  evs train data out/data --scenes 100 --from 100          the second half, on another machine
  evs train data out/data --describe                       light, events and speeds of what is there
  evs train fit out/data --recipe evsnet_c8 -o out/networks

`evs train COMMAND --help` says everything about a command."""

DATA_EXAMPLES = """\
Procedural scenes (rooms, tables, floors, clutter, close-ups) are traced for 448 ms at 1 kHz, for
pixels of a 346 x 260 image: with 1, 4, 16 and 64 samples, fixed and fresh seeds, and converged.
What an ideal event pixel makes of the converged light is what the network should say.

DIR gets data.json (the settings) and NNNNN.npz, one a scene, each whole or not there at all. Given
again, the command goes on where it was; Ctrl-C ends it after the scene it is at, a second one at
once. All follows from the seed, on any number of threads, processes and machines. No robot is among
the scenes: gymnasium's and dm_control's are for tests only, so that tests are of other scenes."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the commands and their arguments."""
    parser.usage = "evs train COMMAND [arguments]"
    parser.epilog = EXAMPLES
    commands = parser.add_subparsers(
        prog="evs train", dest="command", metavar="COMMAND", required=True
    )
    data = commands.add_parser(
        "data",
        help="make training data",
        description="make training data: scenes, their light, and the events they should give",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=DATA_EXAMPLES,
        allow_abbrev=False,
    )
    data.set_defaults(act=_data)
    _configure_data(data)
    learn = commands.add_parser(
        "fit",
        help=train_fit.DESCRIPTION,
        description=train_fit.DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    learn.set_defaults(act=train_fit.run)
    train_fit.configure(learn)


def run(args: argparse.Namespace) -> int:
    """Run one of the commands; the exit code."""
    return int(args.act(args))


def _configure_data(parser: argparse.ArgumentParser) -> None:
    add, usual = parser.add_argument, DataSettings()
    add("folder", metavar="DIR", help="where the shards go; made if it is not there")
    add("--scenes", type=int, default=200, metavar="N", help="how many (200)")
    add("--from", type=int, default=0, metavar="N", dest="first", help="number of the first (0)")
    for key, meaning in (
        ("pixels", "of each scene"),
        ("ticks", "ms of each scene"),
        ("truth-spp", "samples a pixel of converged light"),
        ("seed", "all that is random follows from it"),
    ):
        default = getattr(usual, key.replace("-", "_"))
        add(f"--{key}", type=int, default=default, metavar="N", help=f"{meaning} ({default})")
    add("--workers", type=int, default=1, metavar="N", help="scenes at once, each a process (1)")
    add("--ray", default="", metavar="ADDRESS", help="a Ray cluster makes them: HOST:PORT, or auto")
    add(
        "--threads", type=int, default=0, metavar="N", help="of each scene; 0: a share of the cores"
    )
    add("--describe", action="store_true", help="make nothing; say what DIR holds")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def _data(args: argparse.Namespace) -> int:
    # here, so that --help is quick
    from evs.drivers.run.stop_signals import stop_signals
    from evs.launch.commands.emulate import STOPPED
    from evs.launch.support import terminal
    from evs.tools.training.make import make_data, work_of

    if args.describe:
        from evs.tools.training.describe import describe
        from evs.tools.training.shards import Shards

        for name, value in describe(Shards(args.folder)):
            print(f"{name:30s}{value}")
        return 0
    if not 0 <= args.threads <= 1024:
        raise EvsError(f"--threads is {args.threads}; give 0 for one a core, or 1 ... 1024")
    settings = DataSettings(
        seed=args.seed, pixels=args.pixels, truth_spp=args.truth_spp, ticks=args.ticks
    )
    folder, total = Path(args.folder), args.scenes * work_of(settings)
    with stop_signals() as stopped, terminal.bar("training data", total, args.quiet) as moved:
        made = make_data(
            folder,
            settings,
            range(args.first, args.first + args.scenes),
            args.threads,
            moved,
            lambda: bool(stopped),
            workers=args.workers,
            ray=args.ray,
        )
    if not args.quiet:
        ended = f" ({stopped[0]}; give the command again to go on)" if stopped else ""
        print(f"{folder}: {made.made} scenes made, {made.kept} were there{ended}")
    return STOPPED.get(stopped[0], 0) if stopped else 0
