"""Batches on a cluster: arguments are checked at the call, and a GPU is asked for where needed.

Ray is a stand-in that runs tasks here; test_jobs_cluster.py has the real one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import mujoco
import pytest

import evs
from evs.emulator.config import RenderConfig, SensorConfig
from evs.msgs import EvsError
from evs.tools.jobs import cluster_batches, ray_batches, ray_cluster
from reference.worlds_alone import SWING


class Squares:
    """A data set of squares."""

    threads = 1

    def __init__(self, needs_gpu: bool | None = None) -> None:
        if needs_gpu is not None:
            self.needs_gpu = needs_gpu

    def __getitems__(self, indices: Any) -> list[int]:
        return [one * one for one in indices]


class StandIn:
    """What ray_batches uses of Ray, on nodes with these resources; tasks run when they are sent."""

    exceptions = SimpleNamespace(RayTaskError=ZeroDivisionError, RayError=ZeroDivisionError)

    def __init__(self, *nodes: dict[str, float]) -> None:
        self._nodes = nodes
        self.asked: list[dict[str, Any]] = []
        self.cancelled = 0

    def nodes(self) -> list[dict[str, Any]]:
        dead = {"Alive": False, "Resources": {"CPU": 64.0, "GPU": 8.0}}
        return [dead, *({"Alive": True, "Resources": one} for one in self._nodes)]

    def put(self, value: Any) -> Any:
        return value

    def get(self, value: Any) -> Any:
        return value

    def cancel(self, _: Any, force: bool) -> None:
        assert force
        self.cancelled += 1
        raise RuntimeError("it has ended")

    def remote(self, function: Any) -> Any:
        def options(**wanted: Any) -> Any:
            self.asked.append(wanted)

            def remote(kept: Any, _key: str, indices: Any, *_: Any) -> bytes:
                return ray_batches.pickle.dumps(kept[0].__getitems__(indices))

            return SimpleNamespace(remote=remote)

        return SimpleNamespace(options=options)


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> Any:
    def connect(*nodes: dict[str, float]) -> StandIn:
        ray = StandIn(*nodes)

        @contextlib.contextmanager
        def connected(address: str) -> Iterator[Any]:
            assert address == "auto"
            yield ray

        monkeypatch.setattr(ray_batches, "connected", connected)
        return ray

    return connect


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((Squares(), [[1]], "auto", 0), "threads is 0: give 1 or more"),
        ((Squares(), [[1]], "auto", 1.5), "threads"),
        ((Squares(), [[1]], "10.0.0.1", 1), "ray address '10.0.0.1': give HOST:PORT"),
        ((Squares(), [[1]], "ray://10.0.0.1:1", 1), "give HOST:PORT"),
        ((Squares(), 3, "auto", 1), "batches is 3: give the indices"),
        (([1], [[1]], "auto", 1), r"dataset is \[1\]: give an evs.SimulatedDataset"),
    ],
)
def test_arguments_are_checked_at_the_call(arguments: Any, says: str) -> None:
    *first, threads = arguments
    with pytest.raises(EvsError, match=says) as error:
        cluster_batches(*first, threads=threads)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("needs", "gpus"), [(None, 0), (False, 0), (True, 1)])
def test_a_batch_asks_for_a_gpu_where_it_needs_one(
    stand_in: Any, needs: bool | None, gpus: int
) -> None:
    ray = stand_in({"CPU": 8.0}, {"CPU": 4.0, "GPU": 1.0}, {"CPU": 1.0, "GPU": 4.0})
    found = cluster_batches(Squares(needs), ([n, n + 1] for n in range(20)), threads=2)
    assert next(found) == [0, 1]
    # places: one a GPU with its cores, or one for every two cores; and those that wait
    assert len(ray.asked) == (1 if gpus else 6) + ray_cluster.QUEUED_JOBS
    assert {(one["num_cpus"], one["num_gpus"]) for one in ray.asked} == {(2, gpus)}
    assert [*found] == [[n * n, (n + 1) ** 2] for n in range(1, 20)]
    assert ray.cancelled == 0


def test_what_is_not_taken_is_cancelled(stand_in: Any) -> None:
    ray = stand_in({"CPU": 2.0})
    found = cluster_batches(Squares(), [[n] for n in range(9)])
    next(found)
    found.close()  # type: ignore[attr-defined]
    assert ray.cancelled == 3


@pytest.mark.parametrize(
    ("needs", "says"),
    [
        (False, "no node of the cluster has 3 CPUs for a batch; give fewer threads, or join nodes"),
        (True, "has 3 CPUs and 1 GPU for a batch; take render.device=cpu or auto, or join nodes"),
    ],
)
def test_a_cluster_without_room_is_refused(stand_in: Any, needs: bool, says: str) -> None:
    stand_in({"CPU": 2.0, "GPU": 1.0}, {"CPU": 9.0} if needs else {"CPU": 1.0})
    with pytest.raises(EvsError, match=says):
        next(cluster_batches(Squares(needs), [[1]], threads=3))


def test_a_simulated_data_set_needs_a_gpu_where_its_device_is_cuda() -> None:
    sensor = SensorConfig("dvs128", width=24, height=16)
    scene = mujoco.MjModel.from_xml_string(SWING)
    for device in ("cpu", "auto"):
        render = RenderConfig(device=device)
        dataset = evs.SimulatedDataset(scene, "left", samples=2, sensor=sensor, render=render)
        assert not dataset.needs_gpu
    assert not evs.SimulatedDataset(scene, "left", samples=2, sensor=sensor).needs_gpu
    # as on a machine that has one
    dataset.spec = replace(dataset.spec, render=RenderConfig(device="cuda"))
    assert dataset.needs_gpu
