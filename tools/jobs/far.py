"""What a node of a cluster does for a job: checks that it is like us, makes it, sends the files."""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
import warnings
import zlib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path

from evs.emulator.state.versions import versions
from evs.msgs import EvsError
from evs.tools.jobs.here import job_runs
from evs.tools.jobs.job import Job
from evs.tools.jobs.make import MakeIn
from evs.tools.jobs.parcel import Digest, End, Said, pack

SOURCES = "sources of evs"


@lru_cache(maxsize=1)
def fingerprint() -> dict[str, str]:
    """What must be the same on all machines for the same bytes."""
    python = ".".join(platform.python_version_tuple()[:2])
    told = {"Python": python, **versions(), "zlib": zlib.ZLIB_RUNTIME_VERSION}
    return {**told, SOURCES: _sources(Path(__file__).parents[2])}


def unlike(wanted: Mapping[str, str], found: Mapping[str, str]) -> str:
    """How a machine differs from the one that wants something of it; empty: not at all."""
    return ", ".join(
        f"{name} {found.get(name, 'unknown')} (here {value})"
        for name, value in wanted.items()
        if found.get(name) != value
    )


def make_far(job: Job, wanted: Mapping[str, str], threads: int, where: str) -> Iterator[Said]:
    """Make a job in a temporary folder and give its files, piece by piece.

    In: wanted, the fingerprint of who asks; where, this node's name for messages.
    Raises what the job raises, EvsError where this node is not like who asks.
    """
    differs = unlike(wanted, fingerprint())
    if differs:
        raise EvsError(f"node {where} has {differs}; install the same on every node")
    with (
        tempfile.TemporaryDirectory(prefix="evs-job-") as folder,
        warnings.catch_warnings(record=True) as warned,
    ):
        with job_runs(threads, lambda _: None):
            made = MakeIn(Path(folder))(job)
        digest = Digest()
        for said in pack(made):
            digest.add(said)
            yield said
        yield End(digest.told(), tuple((str(each.message), each.category) for each in warned))


def _sources(package: Path) -> str:
    """Digest of the package's Python files and tables: version numbers do not see an edit."""
    whole = hashlib.sha256()
    # a checkout is a folder of links, and has the native core's sources, which wheels lack
    for here, folders, names in os.walk(package, followlinks=True):
        folders[:] = sorted(set(folders) - {"__pycache__", "core"})
        for name in sorted(names):
            if name.endswith((".py", ".toml")):
                path = Path(here, name)
                whole.update(path.relative_to(package).as_posix().encode() + b"\0")
                whole.update(path.read_bytes() + b"\0")
    return whole.hexdigest()[:12]
