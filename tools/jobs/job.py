"""Job: a pure function with a name that writes files. Ran: what came of a set of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from evs.msgs import EvsError


class Job(Protocol):
    """A frozen dataclass of a module, which pickle can carry to another process or machine."""

    @property
    def name(self) -> str:
        """Path under the target where the files arrive, such as `00012.npz` or `night/0003`."""

    def make(self, folder: Path) -> None:
        """Write the files into an empty folder, and nothing anywhere else.

        The folder arrives as `target/name`. One file alone that bears the last part of the name
        arrives itself. What is written must follow from the job's fields: it may be made twice.
        `job_threads` says how many threads it may use, `tell_share` how far it is. Raises EvsError.
        """


@dataclass(frozen=True)
class Ran:
    """What run_jobs did."""

    made: int
    """jobs that are new"""
    kept: int
    """jobs that were there"""
    left: int
    """jobs that are still to be done, because it was stopped"""
    lost: tuple[str, ...] = ()
    """one line for each worker or node that died over a job, which was then made elsewhere"""


def check_names(names: Iterable[str]) -> None:
    """EvsError where a name is no path below the target, or stands for two jobs."""
    seen: set[str] = set()
    for name in names:
        parts = name.split("/")
        if any(not part or part.startswith(".") or "\0" in part for part in parts):
            raise EvsError(f"job '{name}': its name must be a path below the target folder")
        if name in seen:
            raise EvsError(f"job '{name}' is there twice; each needs a name of its own")
        seen.add(name)
    for name in seen:
        for end in (place for place, sign in enumerate(name) if sign == "/"):
            if name[:end] in seen:
                raise EvsError(f"job '{name}' lies inside job '{name[:end]}'; name one anew")
