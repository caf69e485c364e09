"""What each part of our networks and of their training is worth: a table of ablations.

Every row is a training of 1000 steps on the data of lab/docs/training.md, which are made in
build/training unless they are there, and is scored on the scenes that were held out.
docs/explanation/network.md has the tables that `.venv/bin/pytest -m bench -s
lab/tests/bench/test_training_ablations_study.py` prints. On two cores, the data take half an hour
and the trainings another.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from evs.launch.main import main

pytest.importorskip("jax")

from reference.ablated import ABLATIONS, Outcome, ablated, noisy_rows, simplest

pytestmark = pytest.mark.bench

DATA = Path(__file__).parents[3] / "build/training"
WORDS = ["--scenes", "144", "--pixels", "192", "--truth-spp", "256", "--seed", "1"]
STEPS = 1000
ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def test_each_part_of_a_training(monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["train", "data", str(DATA), *WORDS, "--workers", "2"]) == 0
    monkeypatch.setenv("XLA_FLAGS", ONE_CORE)
    cores = len(os.sched_getaffinity(0))
    spawn = multiprocessing.get_context("spawn")
    # a process for each training: what it compiles may be patched
    with ProcessPoolExecutor(cores, spawn, max_tasks_per_child=1) as workers:
        trained = {
            (row.name, row.spp, seed): workers.submit(ablated, str(DATA), row, STEPS, seed)
            for row in ABLATIONS
            for seed in row.seeds
        }
        noisy = workers.submit(noisy_rows, str(DATA), STEPS, 1)
    print("\n| samples | | EMD | EMD, fast pixels | ON, OFF | recall | static Hz |")
    print("|---|---|---|---|---|---|---|")
    for spp in (4, 1, 16, 64):
        for name, one in simplest(str(DATA), spp).items():
            print(f"| {spp} | {name} | {cells([one])} |")
        for row in ABLATIONS:
            if row.spp == spp:
                outcomes = [trained[row.name, spp, seed].result() for seed in row.seeds]
                print(f"| {spp} | {row.name} | {cells(outcomes)} |")
    print("\n| against noisy pixels | Hz of still pixels | EMD | recall |\n|---|---|---|---|")
    for name, found in noisy.result().items():
        print(f"| {name} | {found.rate_hz:.2f} | {found.emd:.3f} | {found.recall:.2f} |")


def cells(outcomes: list[Outcome]) -> str:
    """Mean of the seeds, and half of their range where there are several."""

    def cell(value: Callable[[Outcome], float], digits: int = 2) -> str:
        found = [value(one) for one in outcomes]
        spread = f" ± {np.ptp(found) / 2:.{digits}f}" if len(found) > 1 else ""
        return f"{np.mean(found):.{digits}f}{spread}"

    return " | ".join(
        (
            cell(lambda one: one.slow.emd, 3),
            cell(lambda one: one.fast.emd),
            f"{cell(lambda one: one.slow.on)}, {cell(lambda one: one.slow.off)}",
            cell(lambda one: one.slow.recall),
            cell(lambda one: one.slow.spurious_hz),
        )
    )
