"""Run a job on a node of a Ray cluster: compare versions, run it, send its files."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import tempfile
import warnings
import zlib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path

from evs.emulator.world import versions
from evs.msgs import EvsError
from evs.tools.jobs.job import Job, JobMaker, job_context
from evs.tools.jobs.packing import Message, StreamDigest, StreamEnd, pack

SOURCES = "sources of evs"


@lru_cache(maxsize=1)
def fingerprint() -> dict[str, str]:
    """Versions that all machines must share to produce the same bytes."""
    python = ".".join(platform.python_version_tuple()[:2])
    found = {"Python": python, **versions(), "zlib": zlib.ZLIB_RUNTIME_VERSION}
    return {**found, SOURCES: _sources(Path(__file__).parents[2])}


def fingerprint_of(job: Job) -> dict[str, str]:
    """fingerprint(), for a job of evs-lab with the sources of evs_lab."""
    package = type(job).__module__.partition(".")[0]
    return (
        {**fingerprint(), **_sources_of(package)} if package.startswith("evs_") else fingerprint()
    )


@lru_cache(maxsize=4)
def _sources_of(package: str) -> dict[str, str]:
    folder = Path(str(sys.modules[package].__file__)).parent
    return {f"sources of {package}": _sources(folder)}


def differences(wanted: Mapping[str, str], found: Mapping[str, str]) -> str:
    """How a machine differs from the one that sent the job, for a message; empty: it does not."""
    return ", ".join(
        f"{name} {found.get(name, 'unknown')} (here {value})"
        for name, value in wanted.items()
        if found.get(name) != value
    )


def make_on_node(
    job: Job, wanted: Mapping[str, str], threads: int, where: str
) -> Iterator[Message]:
    """Run a job in a temporary folder and yield its files, piece by piece.

    Args:
        job: the job.
        wanted: fingerprint of the machine that sent the job.
        threads: threads that the job may use.
        where: name of this node, for messages.

    Raises:
        EvsError: this node differs from the machine that sent the job.
        Exception: whatever the job raises.
    """
    differs = differences(wanted, fingerprint_of(job))
    if differs:
        raise EvsError(f"node {where} has {differs}; install the same on every node")
    with (
        tempfile.TemporaryDirectory(prefix="evs-job-") as folder,
        warnings.catch_warnings(record=True) as warned,
    ):
        with job_context(threads, lambda _: None):
            made = JobMaker(Path(folder))(job)
        digest = StreamDigest()
        for message in pack(made):
            digest.add(message)
            yield message
        yield StreamEnd(
            digest.hexdigest(), tuple((str(each.message), each.category) for each in warned)
        )


def _sources(package: Path) -> str:
    """Digest of the package's Python files and tables, which finds edits that no version shows."""
    hashed = hashlib.sha256()
    # a checkout is a folder of links, and has what wheels lack: the native core's sources, tests
    for here, folders, names in os.walk(package, followlinks=True):
        folders[:] = sorted(set(folders) - {"__pycache__", "core", "tests", "docs"})
        for name in sorted(names):
            if name.endswith((".py", ".toml")) and name != "pyproject.toml":
                path = Path(here, name)
                hashed.update(path.relative_to(package).as_posix().encode() + b"\0")
                hashed.update(path.read_bytes() + b"\0")
    return hashed.hexdigest()[:12]
