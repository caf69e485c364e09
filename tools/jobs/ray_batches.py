"""Fetch batches of a data set on an existing Ray cluster, in order and without files."""

from __future__ import annotations

import pickle
import socket
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol
from uuid import uuid4

from evs.emulator.config.decoding import plain_integer
from evs.msgs import EvsError
from evs.tools.jobs.ray_cluster import cancel_all, check_address, connected, room
from evs.tools.jobs.ray_node import differences, fingerprint
from evs.tools.jobs.worker_pool import MAX_ATTEMPTS


class Dataset(Protocol):
    """A data set whose samples follow from their indices, as evs.SimulatedDataset.

    If it has `needs_gpu` and that is true, a batch takes a GPU of its node.
    """

    threads: int
    """of a process; set on the nodes"""

    def __getitems__(self, indices: Any) -> list[Any]:
        """The samples of a batch."""


def cluster_batches(
    dataset: Dataset,
    batches: Iterable[Sequence[Any]],
    address: str = "auto",
    *,
    threads: int = 1,
    on_lost: Callable[[str], None] = warnings.warn,
) -> Iterator[list[Any]]:
    """Simulate batches on a cluster; yield `dataset.__getitems__(indices)` of each, in order.

        for samples in cluster_batches(dataset, batches, "10.0.0.1:6379"):
            batch = torch.utils.data.default_collate(samples)

    The cluster holds one batch per slot and two more; a batch keeps its slot until it is consumed.
    A batch whose node or worker dies is simulated again, at most three times.

    Args:
        dataset: pickled once; the same versions must be on every node, see run_jobs.
        batches: the indices of each batch, read on demand.
        address: address of the head node, HOST:PORT, or `auto` on a machine of the cluster.
        threads: cores per batch.
        on_lost: called with a line when a batch is fetched again.

    Raises:
        EvsError: an argument is not possible. With the first batch: Ray is not installed, there is
            no cluster at the address, no node has the cores, or the GPU that render.device=cuda
            needs, a node differs from this machine, or a batch cannot be made.
    """
    threads = plain_integer(threads, "threads")
    if threads < 1:
        raise EvsError(f"threads is {threads}: give 1 or more")
    check_address(address)
    if not hasattr(dataset, "__getitems__"):
        raise EvsError(f"dataset is {dataset!r}: give an evs.SimulatedDataset, or one with batches")
    if not isinstance(batches, Iterable):
        raise EvsError(f"batches is {batches!r}: give the indices of each batch")
    return _fetch(dataset, iter(batches), address, threads, on_lost)


def _fetch(
    dataset: Dataset,
    batches: Iterator[Sequence[Any]],
    address: str,
    threads: int,
    on_lost: Callable[[str], None],
) -> Iterator[list[Any]]:
    gpus = 1 if getattr(dataset, "needs_gpu", False) else 0
    with connected(address) as ray:
        runner = _Runner(ray, ray.put(dataset), threads, gpus, on_lost)
        try:
            yield from runner.run(batches)
        finally:
            runner.cancel()


@dataclass
class _Runner:
    """Sends batches to the cluster and receives their samples in order."""

    ray: Any
    kept: Any
    """the data set in the cluster's store"""
    threads: int
    gpus: int
    on_lost: Callable[[str], None]
    key: str = field(default_factory=lambda: uuid4().hex)
    """of the data set"""
    sent: deque[Any] = field(default_factory=deque)
    """references to batches, oldest first"""

    def run(self, batches: Iterator[Sequence[Any]]) -> Iterator[list[Any]]:
        """See cluster_batches."""
        waiting: deque[list[Any]] = deque()
        rest = True
        while True:
            while rest and len(self.sent) < self._room():
                indices = next(batches, None)
                if indices is None:
                    rest = False
                else:
                    waiting.append([*indices])
                    self.sent.append(self._send(waiting[-1]))
            if not self.sent:
                return
            samples = self._receive(waiting[0])
            self.sent.popleft()
            waiting.popleft()
            yield samples

    def cancel(self) -> None:
        """Cancel what is at the cluster."""
        cancel_all(self.ray, self.sent)
        self.sent.clear()

    def _room(self) -> int:
        remedy = "take render.device=cpu or auto" if self.gpus else "give fewer threads"
        return room(self.ray, "a batch", remedy, self.threads, self.gpus)

    def _send(self, indices: list[Any]) -> Any:
        # we repeat lost batches, not Ray, so that each loss is reported
        task = self.ray.remote(_on_node).options(
            name="evs-batch",
            num_cpus=self.threads,
            num_gpus=self.gpus,
            max_retries=0,
            scheduling_strategy="SPREAD",
        )
        # in a list, so that a node fetches it once, and not with every batch
        return task.remote([self.kept], self.key, indices, fingerprint(), self.threads)

    def _receive(self, indices: list[Any]) -> list[Any]:
        """The samples of the oldest batch."""
        errors = self.ray.exceptions
        for attempt in range(1, MAX_ATTEMPTS + 1):
            try:
                # pickled by us: arrays in Ray's store could not be written
                samples: list[Any] = pickle.loads(self.ray.get(self.sent[0]))
                return samples
            except errors.RayTaskError as error:
                cause = error.cause
                if isinstance(cause, EvsError):
                    # without Ray's own text
                    raise EvsError(str(cause)) from None
                raise
            except errors.RayError as error:
                why = type(error).__name__
                if attempt == MAX_ATTEMPTS:
                    raise EvsError(
                        f"the node or worker of a batch died {attempt} times (the last: {why}); "
                        "look at the nodes' memory"
                    ) from None
                self.on_lost(f"a batch's node or worker died ({why}); it is fetched again")
                self.sent[0] = self._send(indices)
        raise AssertionError


_here: dict[str, Dataset] = {}
"""the data set of this worker of a cluster, by its key"""


def _on_node(
    kept: list[Any], key: str, indices: list[Any], wanted: Mapping[str, str], threads: int
) -> bytes:
    """Fetch a batch in a worker of the cluster, which keeps the data set for the next."""
    import ray

    differs = differences(wanted, fingerprint())
    if differs:
        node = f"{socket.gethostname()} ({ray.get_runtime_context().get_node_id()[:8]})"
        raise EvsError(f"node {node} has {differs}; install the same on every node")
    if key not in _here:
        _here.clear()
        _here[key] = ray.get(kept[0])
        _here[key].threads = threads
    return pickle.dumps(_here[key].__getitems__(indices), pickle.HIGHEST_PROTOCOL)
