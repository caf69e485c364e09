"""One way to run many environments, in a process of its own that answers a word a line.

    python many_environments.py WAY ENVS SIZE STEPS THREADS

WAY: worlds (evs.make_vec), sync, async (of gymnasium.vector), single (one LoopEnv, no vector).
"step" answers the seconds of STEPS steps of all environments; "memory" the bytes of this process
and its children, shared pages divided between those that share them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import evs
import evs.drivers.gym

NAME = "evs/CartPole-v0"


def made(way: str, count: int, size: int, threads: int) -> Any:
    shape = (346, 260) if size == 346 else (size, size)
    options: dict[str, Any] = {"observation": "voxel_grid", "size": shape, "max_s": 1e4}
    # a pole that falls ends no episode: every step is one
    options["limits"] = {"angle": (-100.0, 100.0)}
    if way == "worlds":
        return evs.make_vec(NAME, count, threads=threads, copy=False, **options)
    if way == "single":
        return gymnasium.make(NAME, threads=threads, **options)
    # fork shares what is imported, as gymnasium does by itself
    return gymnasium.make_vec(
        NAME, count, vectorization_mode=way, vector_kwargs={"copy": False}, **options
    )


def memory() -> int:
    """Proportional set size of this process and everything below it, bytes."""
    own = {Path("/proc/self").resolve().name}
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[stat.parent.name] = fields[1]
    grown = True
    while grown:
        below = {child for child, parent in parents.items() if parent in own}
        grown = not below <= own
        own |= below
    total = 0
    for process in own:
        try:
            lines = Path("/proc", process, "smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total += sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:"))
    return total


def main() -> None:
    way, (count, size, steps, threads) = sys.argv[1], map(int, sys.argv[2:])
    envs = made(way, count, size, threads)
    shape = (steps, *(envs.action_space.shape))
    actions = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)
    envs.reset(seed=1)
    envs.step(actions[0])
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "memory":
            print(memory(), flush=True)
            continue
        begin = time.perf_counter()
        for action in actions:
            envs.step(action)
        print(time.perf_counter() - begin, flush=True)
    envs.close()


if __name__ == "__main__":
    main()
