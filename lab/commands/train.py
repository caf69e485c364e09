"""`evs train`: make training data, and train the network."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from evs.msgs import EvsError
from evs_lab.training.settings import DataSettings

if TYPE_CHECKING:
    from evs_lab.training.recipes import Recipe

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
With --randomise 'cutoff_hz=log_uniform(50, 500)' each scene has a different sensor. The keys are
those of [sensor]; evs train fit --noisy-truth learns from it.
No scene has a robot: those of gymnasium and dm_control are reserved for tests."""

RECIPES = ("paper", "evsnet_c8", "evsnet_c4")

FIT_HELP = "train a network: by the paper's losses, in JAX, on a GPU if there is one"

FIT_EXAMPLES = """\
examples:
  evs train fit out/data --recipe evsnet_c8 --spp 4 -o config/networks
  evs train fit out/data --recipe paper --minutes 60 -o out/networks
  evs train fit out/data --recipe evsnet_c8 --look-ahead 4 --name evsnet_c8_4ms -o out/networks

recipes:
  evsnet_c8   8 channels, causal, no biases, calibrated counts; for all variants of the light, or
              with --spp N for light of N fresh samples: member NAME_Nspp of family NAME
  evsnet_c4   the same with 4 channels
  paper       8 channels, centred (21 ms late), biases, 64 fresh samples, the paper's loss alone

Whenever the loss on the held-out scenes improves, NAME.onnx, NAME.toml (its sidecar),
NAME.training.json (the report) and NAME.training.png (curves) are written again, so the best
network so far is always on disk. An interrupted training resumes from its checkpoint; with --steps
alone, the result is the same as without the interruption."""


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
        help=FIT_HELP,
        description=FIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    learn.set_defaults(act=_fit)
    _configure_fit(learn)


def run(args: argparse.Namespace) -> int:
    """Run one of the commands; the exit code."""
    return int(args.act(args))


def _configure_data(parser: argparse.ArgumentParser) -> None:
    add, usual = parser.add_argument, DataSettings()
    add("folder", metavar="DIR", help="folder of the data; created if it does not exist")
    add(
        "--randomise",
        action="append",
        default=[],
        metavar="FILE|KEY=RANGE",
        help="a different noisy sensor in each scene: ranges of [sensor], or a TOML file of them",
    )
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
    from evs_lab.training.make import make_data, work_of

    if args.describe:
        from evs_lab.training.shards import Shards, describe

        for name, value in describe(Shards(args.folder)):
            print(f"{name:30s}{value}")
        return 0
    if not 0 <= args.threads <= 1024:
        raise EvsError(f"--threads is {args.threads}; give 0 for one per core, or 1 ... 1024")
    settings = DataSettings(
        seed=args.seed,
        pixels=args.pixels,
        truth_spp=args.truth_spp,
        ticks=args.ticks,
        randomise=_ranges(args),
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


def _ranges(args: argparse.Namespace) -> Mapping[str, str]:
    """The ranges of the noisy sensor."""
    # here, so that --help is quick
    from evs.drivers.run.sensor_ranges import ranges_of

    return ranges_of(args.randomise)


def _configure_fit(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = FIT_EXAMPLES
    add = parser.add_argument
    add("folder", metavar="DIR", help="training data, made by evs train data")
    add("--recipe", default="evsnet_c8", metavar="NAME", help=f"{', '.join(RECIPES)} (evsnet_c8)")
    add("-o", dest="out", required=True, metavar="FOLDER", help="folder of the network")
    add("--name", metavar="NAME", help="name of the network (the recipe's)")
    add("--steps", type=int, metavar="N", help="training steps (the recipe's)")
    add("--minutes", type=float, metavar="M", help="time limit; the learning rate falls to fit it")
    add("--batch", type=int, metavar="N", help="pixels per step (the recipe's)")
    add("--seed", type=int, default=1, metavar="N", help="random seed of weights and order (1)")
    add("--seeds", type=int, default=1, metavar="N", help="train N networks, keep the best (1)")
    add("--spp", type=int, metavar="N", help="for light of N fresh samples alone: NAME_Nspp")
    add("--look-ahead", type=int, metavar="N", help="future ticks that the network reads, 0 ... 21")
    add("--events-per-tick", metavar="NAME", help="of a pixel: one, as in the paper, or many (one)")
    add("--noisy-truth", action="store_true", help="learn a real sensor's noise too")
    add(
        "--checkpoint",
        metavar="FILE.npz",
        help="file to resume from (DIR/NAME-SEED.checkpoint.npz)",
    )
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def _check_fit(args: argparse.Namespace) -> None:
    """Raises EvsError for what needs no library to be refused."""
    if args.seed < 0 or args.seeds < 1:
        raise EvsError("--seed is 0 or more, --seeds 1 or more")
    if args.checkpoint and args.seeds > 1:
        raise EvsError("--checkpoint belongs to one training; leave out --checkpoint or --seeds")
    for key in ("steps", "batch", "spp"):
        if getattr(args, key) is not None and getattr(args, key) < 1:
            raise EvsError(f"--{key} is {getattr(args, key)}; give 1 or more")
    if args.name is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", args.name):
        raise EvsError(f"--name is '{args.name}'; give letters, digits, '_', '-' and '.'")


def _fit(args: argparse.Namespace) -> int:
    """Train; the exit code."""
    folder, out = Path(args.folder), Path(args.out)
    _check_fit(args)
    need_jax()
    # here, so that --help needs no jax
    from evs_lab.training.report import write_network
    from evs_lab.training.settings import read_settings
    from evs_lab.training.training_loop import TrainedNetwork, fit

    def report(line: str) -> None:
        if not args.quiet:
            print(line, flush=True)

    recipe = _recipe(args)
    if read_settings(folder).randomise and not recipe.noisy_truth:
        report("the data have randomised sensors, which only --noisy-truth learns")
    name = args.name or recipe.name
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise EvsError(f"cannot make the folder '{out}': {reason.strerror}") from None

    # of the seeds before
    best = float("inf")

    def improved(fitted: TrainedNetwork) -> None:
        if fitted.score < best:
            files = write_network(fitted, out)
            report(f"wrote {files[0]}")

    for seed in range(args.seed, args.seed + args.seeds):
        default = folder / f"{name}-{seed}.checkpoint.npz"
        minutes = None if args.minutes is None else args.minutes / args.seeds
        fitted = fit(
            folder,
            recipe,
            Path(args.checkpoint or default),
            seed=seed,
            minutes=minutes,
            name=name,
            report=report,
            improved=improved,
        )
        # also after a training that had nothing left to do
        if fitted.score < best:
            best = fitted.score
            write_network(fitted, out)
    return 0


def need_jax() -> None:
    """Raise EvsError where the extra `train` is not installed."""
    missing = [name for name in ("jax", "optax") if importlib.util.find_spec(name) is None]
    if missing:
        raise EvsError(f"training needs {' and '.join(missing)}: pip install './lab[train]'")


def _recipe(args: argparse.Namespace) -> Recipe:
    """The one named, changed as the options say."""
    from evs_lab.training.recipes import recipe_named

    recipe = recipe_named(args.recipe)
    if args.spp is not None:
        recipe = recipe.of_spp(args.spp)
    if args.look_ahead is not None:
        recipe = recipe.with_look_ahead(args.look_ahead)
    if args.events_per_tick is not None:
        recipe = recipe.with_events_per_tick(args.events_per_tick)
    changes = {key: getattr(args, key) for key in ("steps", "batch") if getattr(args, key)}
    return dataclasses.replace(recipe, **changes, noisy_truth=args.noisy_truth)
