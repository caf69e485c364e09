"""Full frames in a row, for a profiler to look at: docs/explanation/tracer.md says how."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from speed.view import robot

SECONDS = 10


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("renderer", ["direct", "path"])
def test_frames_for_a_profiler(renderer: str, robot_files: dict[str, Path]) -> None:
    draw = robot(robot_files["dm_control/humanoid"]).light(1, renderer=renderer)
    frames, end = 0, time.perf_counter() + SECONDS
    while time.perf_counter() < end:
        draw()
        frames += 1
    print(f"\n{renderer}: {frames} frames")
    assert frames > 0
