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
  evs train data out/data --describe                       light, events and speeds in the folder
  evs train fit out/data --recipe evsnet_c8 -o out/networks

`evs train COMMAND --help` describes a command."""

DATA_EXAMPLES = """\
Procedural scenes (rooms, tables, floors, clutter, close-ups) are traced for 448 ms at 1 kHz, for
pixels of a 346 x 260 image: with 1, 4, 16 and 64 samples, fixed and fresh seeds, and converged.
The network learns to give the events of an ideal event pixel in the converged light.

DIR receives data.json (the settings) and one NNNNN.npz per scene. A file appears when it is
complete. Run the command again to resume it; Ctrl-C ends it after the current scene, a second
Ctrl-C at once. The data depend only on the seed, on any number of threads, processes and machines.
No scene has a robot: those of gymnasium and dm_control are reserved for tests."""


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
    add("folder", metavar="DIR", help="folder of the data; created if it does not exist")
    add("--scenes", type=int, default=200, metavar="N", help="number of scenes (200)")
    add("--from", type=int, default=0, metavar="N", dest="first", help="number of the first (0)")
    for key, meaning in (
        ("pixels", "pixels per scene"),
        ("ticks", "ms per scene"),
        ("truth-spp", "samples per pixel of the converged light"),
        ("seed", "random seed"),
    ):
        default = getattr(usual, key.replace("-", "_"))
        add(f"--{key}", type=int, default=default, metavar="N", help=f"{meaning} ({default})")
    add(
        "--workers", type=int, default=1, metavar="N", help="parallel processes, one scene each (1)"
    )
    add("--ray", default="", metavar="ADDRESS", help="use a Ray cluster: HOST:PORT, or auto")
    add(
        "--threads",
        type=int,
        default=0,
        metavar="N",
        help="threads per scene; 0: a share of the cores",
    )
    add("--describe", action="store_true", help="only describe what DIR holds")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def _data(args: argparse.Namespace) -> int:
    # here, so that --help is quick
    from evs.drivers.run.stop_signals import stop_signals
    from evs.launch.commands.emulate import STOPPED
    from evs.launch.support import terminal
    from evs.tools.training.make import make_data, work_of

    if args.describe:
        from evs.tools.training.shards import Shards, describe

        for name, value in describe(Shards(args.folder)):
            print(f"{name:30s}{value}")
        return 0
    if not 0 <= args.threads <= 1024:
        raise EvsError(f"--threads is {args.threads}; give 0 for one per core, or 1 ... 1024")
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
