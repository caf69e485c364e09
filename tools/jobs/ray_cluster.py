"""Run jobs on an existing Ray cluster."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from evs.msgs import EvsError
from evs.tools.jobs.job import Job, remedy_for
from evs.tools.jobs.packing import Unpacker
from evs.tools.jobs.ray_node import fingerprint, fingerprint_of, make_on_node
from evs.tools.jobs.worker_pool import MAX_ATTEMPTS, name_of

JobT = TypeVar("JobT", bound=Job)

QUEUED_JOBS = 2
"""jobs that are queued at the cluster, so that no node is idle"""
MAX_PIECES_IN_FLIGHT = 4
"""of one job, as backpressure"""
POLL_S = 0.5
"""how often `stopped` is polled"""
CONNECT_TIMEOUT_S = 5.0
"""for the head node"""


def run_on_cluster(
    todo: list[JobT],
    address: str,
    staging: Path,
    *,
    threads: int,
    stopped: Callable[[], bool],
    on_lost: Callable[[str], None],
) -> Generator[tuple[JobT, Path], None, None]:
    """Run all of `todo` on a cluster; yield each job with its folder below `staging`.

    As in run_units, the caller may add to `todo` while it iterates; a job that raises ends the
    iteration after the jobs that run; a job whose node or worker dies is run again, MAX_ATTEMPTS
    times at most.

    Raises:
        EvsError: Ray is not installed, there is no cluster at the address, or a node differs from
            this machine.
    """
    with connected(address) as ray:
        runner: _ClusterRunner[JobT] = _ClusterRunner(ray, staging, max(1, threads), on_lost)
        try:
            yield from runner.run_units(todo, stopped)
        finally:
            runner.cancel()


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to a cluster and yield the ray module. An existing connection is kept.

    Raises:
        EvsError: one line that says why there is no connection.
    """
    # read when ray is imported: send no usage statistics
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise EvsError("a cluster needs Ray: pip install 'evs[cluster]'") from None
    if ray.is_initialized():
        yield ray
        return
    _check_reachable(address)
    # ray takes SIGTERM for itself
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL)
    except Exception as reason:
        ray.shutdown()
        raise _no_cluster(address, reason) from None
    finally:
        if is_main:
            signal.signal(signal.SIGTERM, before)
    # it prints on stdout why nodes die; we report lost jobs ourselves
    ray._private.worker._worker_logs_enabled = False  # pyright: ignore[reportPrivateImportUsage]
    try:
        yield ray
    finally:
        ray.shutdown()
        ray._private.worker._worker_logs_enabled = True  # pyright: ignore[reportPrivateImportUsage]


def room(ray: Any, what: str, remedy: str, threads: int, gpus: int = 0) -> int:
    """How many tasks the cluster may hold now; nodes come and go.

    Args:
        ray: the module, connected.
        what: a task, for messages.
        remedy: what else to do than join nodes, for messages.
        threads: CPUs of a task.
        gpus: GPUs of a task.

    Raises:
        EvsError: no node has as many.
    """
    nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    places = sum(
        min(
            int(node.get(kind, 0)) // each
            for kind, each in (("CPU", threads), ("GPU", gpus))
            if each
        )
        for node in nodes
    )
    if places == 0:
        wants = f"{threads} CPUs" + (f" and {gpus} GPU" if gpus else "")
        raise EvsError(f"no node of the cluster has {wants} for {what}; {remedy}, or join nodes")
    return places + QUEUED_JOBS


def cancel_all(ray: Any, references: Iterable[Any]) -> None:
    """Cancel tasks, whatever state they are in."""
    for one in references:
        with contextlib.suppress(Exception):
            ray.cancel(one, force=True)


def _check_reachable(address: str) -> None:
    """Raise EvsError if no cluster listens; Ray itself would try for a minute."""
    check_address(address)
    if address == "auto":
        return
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), CONNECT_TIMEOUT_S).close()
    except OSError as reason:
        raise _no_cluster(address, reason) from None


def check_address(address: str) -> None:
    """Raise EvsError if it is neither `auto` nor HOST:PORT."""
    if address == "auto":
        return
    host, _, port = str(address).rpartition(":")
    if "/" in str(address) or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise EvsError(
            f"ray address '{address}': give HOST:PORT of the head node, or `auto` on a machine of "
            "the cluster"
        )


def _no_cluster(address: str, reason: Exception) -> EvsError:
    text = " ".join(str(reason).split())
    if "ersion mismatch" in text:
        return EvsError(f"the Ray cluster at {address} is another one than here: {text}")
    start = "ray start --head --disable-usage-stats"
    if address == "auto":
        return EvsError(f"no Ray cluster on this machine: start one with {start}")
    return EvsError(
        f"no Ray cluster at {address} that this machine belongs to ({text}): start one with "
        f"{start}, join it with ray start --address={address}"
    )


@dataclass
class _SentJob(Generic[JobT]):
    """A job at the cluster, and the files that have come."""

    job: JobT
    unpacker: Unpacker


@dataclass
class _ClusterRunner(Generic[JobT]):
    """Sends jobs to the cluster and receives their files."""

    ray: Any
    staging: Path
    threads: int
    on_lost: Callable[[str], None]
    sent: dict[Any, _SentJob[JobT]] = field(default_factory=dict)
    """stream of a job's messages -> the job"""
    retries: list[JobT] = field(default_factory=list)
    attempts: Counter[str] = field(default_factory=Counter)
    failure: Exception | None = None

    def run_units(
        self, todo: list[JobT], stopped: Callable[[], bool]
    ) -> Iterator[tuple[JobT, Path]]:
        """See run_on_cluster."""
        while True:
            while (todo or self.retries) and self.failure is None and len(self.sent) < self._room():
                # jobs of lost nodes go first; after a stop both lists stay
                if stopped():
                    break
                self._send((self.retries or todo).pop(0))
            if not self.sent:
                break
            ready, _ = self.ray.wait(list(self.sent), timeout=POLL_S)
            for stream in ready:
                yield from self._receive(stream)
        if self.failure is not None:
            raise self.failure

    def cancel(self) -> None:
        """Cancel the jobs that are at the cluster."""
        cancel_all(self.ray, self.sent)
        self.sent.clear()

    def _room(self) -> int:
        return room(self.ray, "a job", "give fewer --threads", self.threads)

    def _send(self, job: JobT) -> None:
        # we retry lost jobs, not Ray, so that each loss is reported
        task = self.ray.remote(_on_node).options(
            name=name_of(job),
            num_cpus=self.threads,
            max_retries=0,
            num_returns="streaming",
            scheduling_strategy="SPREAD",
            _generator_backpressure_num_objects=MAX_PIECES_IN_FLIGHT,
        )
        self.sent[task.remote(job, fingerprint_of(job), self.threads)] = _SentJob(
            job, self._new_unpacker(job)
        )

    def _new_unpacker(self, job: JobT) -> Unpacker:
        # a folder for each attempt: the one before may be incomplete
        return Unpacker(self.staging / str(self.attempts[job.name]) / job.name)

    def _receive(self, stream: Any) -> Iterator[tuple[JobT, Path]]:
        """Receive one message of a job; yield the job if that was the last."""
        sent_job = self.sent[stream]
        job, unpacker, errors = sent_job.job, sent_job.unpacker, self.ray.exceptions
        try:
            unpacker.write(self.ray.get(next(stream)))
        except StopIteration:
            del self.sent[stream]
            if unpacker.end is None:
                self._retry_or_fail(job, "its files ended early")
                return
            for text, category in unpacker.end.warnings:
                warnings.warn(text, category, stacklevel=2)
            yield job, unpacker.folder
        except errors.RayTaskError as error:
            del self.sent[stream]
            self._fail(job, error)
        except errors.RayError as error:
            del self.sent[stream]
            self._retry_or_fail(job, type(error).__name__)
        except OSError as reason:
            text = f"{job.name}: cannot write its files: {reason.strerror}"
            raise EvsError(text + remedy_for(reason)) from None

    def _fail(self, job: JobT, error: Any) -> None:
        cause = error.cause
        if isinstance(cause, MemoryError):
            self._retry_or_fail(job, "it found no memory")
            return
        if isinstance(cause, EvsError):
            # without Ray's own text
            cause = EvsError(str(cause))
        elif isinstance(cause, ImportError | self.ray.exceptions.RayError):
            # the node could not unpickle the job
            text = str(error).strip().splitlines()[-1].strip()
            cause = EvsError(
                f"{job.name}: a node cannot take the job ({text}); install evs "
                f"{fingerprint()['evs']} with the same extras on every node"
            )
        else:
            cause.add_note(f"in job {job.name}, on a node:\n{error}")
        self.failure = self.failure or cause

    def _retry_or_fail(self, job: JobT, why: str) -> None:
        self.attempts[job.name] += 1
        count = self.attempts[job.name]
        if count < MAX_ATTEMPTS:
            self.retries.append(job)
            self.on_lost(f"{job.name}: its node or worker died ({why}); it is made again")
            return
        self.failure = self.failure or EvsError(
            f"{job.name}: its node or worker died {count} times (the last: {why}); look at the "
            "nodes' memory"
        )


def _on_node(job: Job, wanted: dict[str, str], threads: int) -> Iterator[Any]:
    import ray

    node = ray.get_runtime_context().get_node_id()[:8]
    yield from make_on_node(job, wanted, threads, f"{socket.gethostname()} ({node})")
