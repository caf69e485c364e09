"""`evs train fit`: a network from training data, by a recipe."""

from __future__ import annotations

import argparse
import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING

from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.tools.training.recipes import Recipe

RECIPES = ("paper", "evsnet_c8", "evsnet_c4")

DESCRIPTION = "train a network: by the paper's losses, in JAX, on a GPU where there is one"

EXAMPLES = """\
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
    """Declare the arguments."""
    parser.epilog = EXAMPLES
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
    add("--noisy-truth", action="store_true", help="learn a real sensor's noise too")
    add(
        "--checkpoint",
        metavar="FILE.npz",
        help="file to resume from (DIR/NAME-SEED.checkpoint.npz)",
    )
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def _check(args: argparse.Namespace) -> None:
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


def run(args: argparse.Namespace) -> int:
    """Train; the exit code."""
    folder, out = Path(args.folder), Path(args.out)
    _check(args)
    # here, so that --help needs no jax
    from evs.tools.training import need_jax

    need_jax()
    from evs.tools.training.fit import TrainedNetwork, fit
    from evs.tools.training.report import write_network

    recipe = _recipe(args)
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

    def report(line: str) -> None:
        if not args.quiet:
            print(line, flush=True)

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


def _recipe(args: argparse.Namespace) -> Recipe:
    """The one named, changed as the options say."""
    from evs.tools.training.recipes import recipe_named

    recipe = recipe_named(args.recipe)
    if args.spp is not None:
        recipe = recipe.of_spp(args.spp)
    if args.look_ahead is not None:
        recipe = recipe.with_look_ahead(args.look_ahead)
    changes = {key: getattr(args, key) for key in ("steps", "batch") if getattr(args, key)}
    return dataclasses.replace(recipe, **changes, noisy_truth=args.noisy_truth)
