"""Time of a traced frame beside MuJoCo's own OpenGL renderer in software, in the same run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from speed.elsewhere import AbsentError
from speed.mujoco_gl import software_gl
from speed.turns import Table, Time, milliseconds, target
from speed.view import FRAME, SCENES, View, robot

DEFAULT_GL, SINGLE_GL = "MuJoCo GL, 4 samples (its default)", "MuJoCo GL, 1 sample"
DIRECT, DIRECT_4 = "direct, 1 sample", "direct, 4 samples"
# MuJoCo's default
GL_SAMPLES = 4


def likeness(view: View, drawn: np.ndarray) -> float:
    """Correlation of the two pictures, of which one is coded for a display."""
    ours, theirs = np.cbrt(view.light(1, 4)()), drawn.mean(-1)
    return float(np.corrcoef(ours.ravel(), theirs.ravel())[0, 1])


def times_of(view: View, threads: int) -> dict[str, Time]:
    with software_gl(view, threads) as gl:
        assert likeness(view, gl.call(GL_SAMPLES)) > 0.8
        return milliseconds(
            {
                DEFAULT_GL: lambda: gl.run(GL_SAMPLES),
                SINGLE_GL: lambda: gl.run(0),
                DIRECT: view.light(threads),
                DIRECT_4: view.light(threads, 4),
            },
            rounds=9,
        )


@pytest.mark.bench
@pytest.mark.parametrize("threads", [1, 2])
def test_direct_beside_mujoco_gl(threads: int, robot_files: dict[str, Path]) -> None:
    try:
        columns = {scene: times_of(robot(robot_files[scene]), threads) for scene in SCENES}
    except AbsentError as missing:
        print(f"\ndirect beside MuJoCo GL: {missing}")
        return
    title = f"direct beside MuJoCo's GL renderer (Mesa llvmpipe), {FRAME}, threads of each: "
    yardsticks = dict.fromkeys((SINGLE_GL, DIRECT, DIRECT_4), DEFAULT_GL)
    print(table := Table(f"{title}{threads}", columns, yardsticks))
    humanoid = SCENES[1]
    print(target(f"{DIRECT}, {humanoid}", table.ratio(humanoid, DIRECT), 40, "x"))
