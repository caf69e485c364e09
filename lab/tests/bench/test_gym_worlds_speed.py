"""Environments x steps a second: evs.make_vec beside as many processes and SyncVectorEnv.

.venv/bin/pytest -m bench -s lab/tests/bench/test_gym_worlds_speed.py
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from speed.turns import Time, spread

PROGRAM = Path(__file__).parents[1] / "support" / "speed" / "many_environments.py"
ROUNDS = 7
# environments, px, steps a round; 256 processes do not fit into 24 GB
CASES = ((1, 64, 80), (16, 64, 20), (64, 64, 6), (256, 64, 2), (16, 346, 2))
MOST_PROCESSES = 64


class Way:
    """A process that runs many environments in one way."""

    def __init__(self, way: str, case: tuple[int, int, int], threads: int) -> None:
        count, size, steps = case
        words = [way, str(count), str(size), str(steps), str(threads)]
        # one core where one thread is asked for, whoever would take two
        pinned = ["taskset", "-c", "0"] if threads == 1 else []
        self._process = subprocess.Popen(
            [*pinned, sys.executable, str(PROGRAM), *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._read() == "ready"
        self._done = count * steps

    def _read(self) -> str:
        assert self._process.stdout
        return self._process.stdout.readline().strip()

    def _ask(self, word: str) -> float:
        assert self._process.stdin
        self._process.stdin.write(word + "\n")
        self._process.stdin.flush()
        return float(self._read())

    def rate(self) -> float:
        """Environments x steps a second, in one round."""
        return self._done / self._ask("step")

    def memory_mb(self) -> float:
        return self._ask("memory") / 1e6

    def close(self) -> None:
        self._process.communicate(timeout=60)


def measured(case: tuple[int, int, int], threads: int) -> dict[str, tuple[Time, float]]:
    """Way -> environments x steps a second, and memory in MB; they take turns."""
    names = ["worlds", "sync", *(["async"] if case[0] <= MOST_PROCESSES else [])]
    if case[0] == 1:
        names.append("single")
    ways = {name: Way(name, case, threads) for name in names}
    rates: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(ROUNDS + 1):
        for name, way in ways.items():
            rate = way.rate()
            if turn:
                rates[name].append(rate)
    found = {name: (spread(rates[name]), way.memory_mb()) for name, way in ways.items()}
    for way in ways.values():
        way.close()
    return found


@pytest.mark.bench
@pytest.mark.parametrize("threads", [2, 1])
def test_environments_and_steps_a_second(threads: int) -> None:
    print(f"\n{threads} core(s); environments x steps/s: median (quartiles); memory, MB\n")
    print(
        "| environments, px | evs.make_vec | SyncVectorEnv | AsyncVectorEnv | one LoopEnv |"
        " times the better | share of its memory |"
    )
    print("|---|---|---|---|---|---|---|")
    for case in CASES:
        found = measured(case, threads)
        cells = [
            f"{found[name][0]}; {found[name][1]:.0f} MB" if name in found else "-"
            for name in ("worlds", "sync", "async", "single")
        ]
        others = [found[name][0].median for name in ("sync", "async") if name in found]
        ratio = found["worlds"][0].median / max(others)
        share = found["worlds"][1] / found["async"][1] if "async" in found else float("nan")
        print(f"| {case[0]}, {case[1]} | {' | '.join(cells)} | {ratio:.2f} | {share:.2f} |")
        assert ratio > 0
