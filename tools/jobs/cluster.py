"""Jobs on a Ray cluster that is there: the one door to Ray."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from evs.msgs import EvsError
from evs.tools.jobs.far import fingerprint, make_far
from evs.tools.jobs.job import Job
from evs.tools.jobs.make import mend_of
from evs.tools.jobs.parcel import Parcel
from evs.tools.jobs.work import TRIES, name_of

JobT = TypeVar("JobT", bound=Job)

AHEAD = 2
"""jobs that wait at the cluster, so that no node waits for us"""
UNDER_WAY = 4
"""pieces of one job that are on their way at once"""
LOOK_S = 0.5
"""how often a wish to stop is looked for"""
REACH_S = 5.0
"""how long a head node may take to answer"""


def work_far(
    todo: list[JobT],
    address: str,
    making: Path,
    *,
    threads: int,
    stopped: Callable[[], bool],
    on_lost: Callable[[str], None],
) -> Generator[tuple[JobT, Path], None, None]:
    """Have all of `todo` made by a cluster, and give each job with its folder below `making`.

    As work_off: whoever iterates may add to `todo`, a job that raises ends it after those that run,
    one whose node or worker dies is made again, TRIES times at most. Raises EvsError: no Ray, no
    cluster at the address, a node that is not like this machine.
    """
    with connected(address) as ray:
        far: _Far[JobT] = _Far(ray, making, max(1, threads), on_lost)
        try:
            yield from far.work_off(todo, stopped)
        finally:
            far.drop()


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """Ray's module, connected. Raises EvsError in one line.

    Where this process is a driver of Ray already, it stays one afterwards.
    """
    # read when ray is imported: nothing is told to anybody
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise EvsError("a cluster needs Ray: pip install 'evs[cluster]'") from None
    if ray.is_initialized():
        yield ray
        return
    _reach(address)
    # ray takes SIGTERM for itself
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL)
    except Exception as reason:
        ray.shutdown()
        raise _unreached(address, reason) from None
    finally:
        if is_main:
            signal.signal(signal.SIGTERM, before)
    # it prints on stdout what nodes die of; we tell it where a job is lost
    ray._private.worker._worker_logs_enabled = False  # pyright: ignore[reportPrivateImportUsage]
    try:
        yield ray
    finally:
        ray.shutdown()
        ray._private.worker._worker_logs_enabled = True  # pyright: ignore[reportPrivateImportUsage]


def _reach(address: str) -> None:
    """EvsError where nobody listens: Ray itself would try for a minute."""
    if address == "auto":
        return
    host, _, port = address.rpartition(":")
    if "/" in address or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise EvsError(
            f"ray address '{address}': give HOST:PORT of the head node, or `auto` on a machine of "
            "the cluster"
        )
    try:
        socket.create_connection((host, int(port)), REACH_S).close()
    except OSError as reason:
        raise _unreached(address, reason) from None


def _unreached(address: str, reason: Exception) -> EvsError:
    told = " ".join(str(reason).split())
    if "ersion mismatch" in told:
        return EvsError(f"the Ray cluster at {address} is another one than here: {told}")
    start = "ray start --head --disable-usage-stats"
    if address == "auto":
        return EvsError(f"no Ray cluster on this machine: start one with {start}")
    return EvsError(
        f"no Ray cluster at {address} that this machine belongs to ({told}): start one with "
        f"{start}, join it with ray start --address={address}"
    )


@dataclass
class _Trip(Generic[JobT]):
    """A job that the cluster has, and what came of it so far."""

    job: JobT
    parcel: Parcel


@dataclass
class _Far(Generic[JobT]):
    """The jobs at the cluster."""

    ray: Any
    making: Path
    threads: int
    on_lost: Callable[[str], None]
    trips: dict[Any, _Trip[JobT]] = field(default_factory=dict)
    """stream of a job -> what it is"""
    again: list[JobT] = field(default_factory=list)
    tries: Counter[str] = field(default_factory=Counter)
    failure: Exception | None = None

    def work_off(
        self, todo: list[JobT], stopped: Callable[[], bool]
    ) -> Iterator[tuple[JobT, Path]]:
        """As the function."""
        wanted = fingerprint()
        while True:
            while (todo or self.again) and self.failure is None and len(self.trips) < self._room():
                # what a lost node left goes first; a stop leaves both
                if stopped():
                    break
                self._send((self.again or todo).pop(0), wanted)
            if not self.trips:
                break
            ready, _ = self.ray.wait(list(self.trips), timeout=LOOK_S)
            for stream in ready:
                yield from self._hear(stream)
        if self.failure is not None:
            raise self.failure

    def drop(self) -> None:
        """Let go of what is at the cluster."""
        for stream in self.trips:
            with contextlib.suppress(Exception):
                self.ray.cancel(stream, force=True)
        self.trips.clear()

    def _room(self) -> int:
        """How many jobs the cluster may have: nodes come and go."""
        nodes = [node for node in self.ray.nodes() if node["Alive"]]
        places = sum(int(node["Resources"].get("CPU", 0)) // self.threads for node in nodes)
        if places == 0:
            raise EvsError(
                f"no node of the cluster has {self.threads} CPUs for a job; give fewer --threads, "
                "or join nodes"
            )
        return places + AHEAD

    def _send(self, job: JobT, wanted: dict[str, str]) -> None:
        # a lost job is made again by us and not by Ray, so that it is told
        task = self.ray.remote(_on_node).options(
            name=name_of(job),
            num_cpus=self.threads,
            max_retries=0,
            num_returns="streaming",
            scheduling_strategy="SPREAD",
            _generator_backpressure_num_objects=UNDER_WAY,
        )
        self.trips[task.remote(job, wanted, self.threads)] = _Trip(job, self._parcel(job))

    def _parcel(self, job: JobT) -> Parcel:
        # a name of its own for each try: what came of the one before may be half
        return Parcel(self.making / str(self.tries[job.name]) / job.name)

    def _hear(self, stream: Any) -> Iterator[tuple[JobT, Path]]:
        """Take one piece of a job that is ready to give one."""
        trip = self.trips[stream]
        job, parcel, errors = trip.job, trip.parcel, self.ray.exceptions
        try:
            parcel.take(self.ray.get(next(stream)))
        except StopIteration:
            del self.trips[stream]
            if parcel.end is None:
                self._lose(job, "its files ended early")
                return
            for text, category in parcel.end.warnings:
                warnings.warn(text, category, stacklevel=2)
            yield job, parcel.folder
        except errors.RayTaskError as error:
            del self.trips[stream]
            self._fail(job, error)
        except errors.RayError as error:
            del self.trips[stream]
            self._lose(job, type(error).__name__)
        except OSError as reason:
            told = f"{job.name}: cannot write its files: {reason.strerror}"
            raise EvsError(told + mend_of(reason)) from None

    def _fail(self, job: JobT, error: Any) -> None:
        cause = error.cause
        if isinstance(cause, MemoryError):
            self._lose(job, "it found no memory")
            return
        if isinstance(cause, EvsError):
            # without what Ray tells of its own
            cause = EvsError(str(cause))
        elif isinstance(cause, ImportError | self.ray.exceptions.RayError):
            # it came no further than reading the job
            told = str(error).strip().splitlines()[-1].strip()
            cause = EvsError(
                f"{job.name}: a node cannot take the job ({told}); install evs "
                f"{fingerprint()['evs']} with the same extras on every node"
            )
        else:
            cause.add_note(f"in job {job.name}, on a node:\n{error}")
        self.failure = self.failure or cause

    def _lose(self, job: JobT, why: str) -> None:
        self.tries[job.name] += 1
        count = self.tries[job.name]
        if count < TRIES:
            self.again.append(job)
            self.on_lost(f"{job.name}: its node or worker died ({why}); it is made again")
            return
        self.failure = self.failure or EvsError(
            f"{job.name}: its node or worker died {count} times (the last: {why}); look at the "
            "nodes' memory"
        )


def _on_node(job: Job, wanted: dict[str, str], threads: int) -> Iterator[Any]:
    import ray

    node = ray.get_runtime_context().get_node_id()[:8]
    yield from make_far(job, wanted, threads, f"{socket.gethostname()} ({node})")
