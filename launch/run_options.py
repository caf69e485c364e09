"""--workers, --ray and --threads: what programs that run jobs share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from evs.msgs import EvsError


def configure(add: Callable[..., Any], job: str) -> None:
    """Declare the three. In: add, a parser's add_argument; job, what one of them is called."""
    add("--workers", type=int, default=1, metavar="N", help=f"{job}s at once, each a process (1)")
    add(
        "--ray",
        default="",
        metavar="ADDRESS",
        help=f"have the {job}s made by a Ray cluster: HOST:PORT of its head, or auto",
    )
    add(
        "--threads",
        type=int,
        default=0,
        metavar="N",
        help=f"of each {job}; 0: its share of the cores, 1 on a cluster",
    )


def check(args: argparse.Namespace) -> None:
    """EvsError for nonsense."""
    if not 0 <= args.threads <= 1024:
        raise EvsError(f"--threads is {args.threads}; give 0 for one a core, or 1 ... 1024")
    if not 1 <= args.workers <= 1024:
        raise EvsError(f"--workers is {args.workers}; give 1 ... 1024")
    if args.ray and args.workers != 1:
        raise EvsError("--ray has workers of its own; give --workers or --ray, not both")
