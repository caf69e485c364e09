"""The event pixel as code for GPUs: no fma, nothing approximate, denormals flushed."""

from __future__ import annotations

import re

import pytest
from gpu.compile import compiled
from gpu.ptx import faults

DAVIS = {"EVS_RUNNING_MEAN": 0, "EVS_PHOTON_NOISE": 0, "EVS_SHOT_NOISE": 1, "EVS_LOG": 0}


@pytest.mark.parametrize(
    ("architecture", "terms"),
    [
        (75, {**DAVIS, "EVS_FILTER": 2}),
        pytest.param(80, {**DAVIS, "EVS_FILTER": 0, "EVS_MANY": 1}, marks=pytest.mark.slow),
        pytest.param(
            120,
            {**DAVIS, "EVS_LOG": 1, "EVS_FILTER": 1, "EVS_RUNNING_MEAN": 1},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            90,
            {"EVS_PHOTON_NOISE": 1, "EVS_RUNNING_MEAN": 0, "EVS_LOG": 2, "EVS_FILTER": 0},
            marks=pytest.mark.slow,
        ),
    ],
    ids=["davis", "many", "euler", "photons"],
)
def test_instructions_are_those_of_a_cpu(architecture: int, terms: dict[str, int]) -> None:
    ptx = compiled("pixels", f"compute_{architecture}", terms).decode()
    step = "step_blocks_of_many" if "EVS_MANY" in terms else "step_blocks"
    kernels = {"prepare", step, "place_crossings", "pack_crossings"}
    assert set(re.findall(r"\.entry (\w+)", ptx)) == kernels
    assert faults(ptx) == []
