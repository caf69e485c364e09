"""Train PPO of Stable-Baselines3 on the cart pole and draw its learning curve: a PNG.

Run by `sh .ci/learners.sh curve`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import evs
from evs.drivers.gym.stable_baselines import StableBaselinesEnvs
from evs.drivers.pictures.chart import Chart, Scale, Series, draw_charts
from evs.drivers.pictures.image_files import write_png

STEPS, EVERY = 200_000, 10_000
ENDS = range(EVERY, STEPS + 1, EVERY)
COLOUR = (0, 114, 255)
MOST = 500.0
"""return of an episode in which the pole stands for 5 s"""


class Returns(BaseCallback):
    """Collects (steps until then, return) of each episode; the reward of a step is 1."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[int, float]] = []
        self._now = np.zeros(0)

    def _on_step(self) -> bool:
        rewards, ends = self.locals["rewards"], self.locals["dones"]
        self._now = rewards + (self._now if len(self._now) else 0.0)
        self.found += [(self.num_timesteps, float(one)) for one in self._now[ends]]
        self._now[ends] = 0.0
        return True


def curve() -> list[float]:
    """The mean return of the episodes that ended in each EVERY steps."""
    options: dict[str, Any] = {"size": (24, 18), "observation": "voxel_grid"}
    envs = evs.make_vec("evs/CartPole-v0", 16, autoreset_mode="SameStep", **options)
    returns = Returns()
    learner = PPO("MlpPolicy", StableBaselinesEnvs(envs), n_steps=128, seed=0, device="cpu")
    learner.learn(STEPS, callback=returns)
    return [
        float(np.mean([worth for step, worth in returns.found if end - EVERY < step <= end]))
        for end in ENDS
    ]


def main() -> None:
    """Train; the PNG is the first argument."""
    torch.set_num_threads(1)
    means = curve()
    print(" ".join(f"{mean:.0f}" for mean in means))
    chart = Chart(
        f"Mean return of the episodes in each {EVERY:,} steps; {MOST:.0f} is the most",
        Scale(0.0, STEPS),
        Scale(0.0, MOST),
        "steps",
        [Series(ENDS, means, COLOUR, line=True), Series(ENDS, means, COLOUR)],
    )
    write_png(Path(sys.argv[1]), draw_charts([chart], 1, (760, 420)), few_colours=True)


if __name__ == "__main__":
    main()
