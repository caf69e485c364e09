"""The kernels of light as code for GPUs: no fma, nothing approximate, denormals flushed."""

from __future__ import annotations

import re

import pytest
from gpu.compile import compiled
from gpu.ptx import faults

from evs.emulator.base.gpu.compiler import SAME_BYTES


@pytest.mark.parametrize("architecture", [75, 80, 90, 120])
@pytest.mark.parametrize("kernel", ["math", "comparator"])
def test_instructions_are_those_of_a_cpu(kernel: str, architecture: int) -> None:
    ptx = compiled(kernel, f"compute_{architecture}").decode()
    assert f".target sm_{architecture}" in ptx
    assert len(re.findall(r"\b(?:add|mul)\.[\w.]*f(?:32|64)\b", ptx)) > 5
    assert faults(ptx) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("architecture", "channels", "kernel"),
    [
        *((75, 1, "second_pass"), (80, 3, "direct"), (90, 1, "direct_of_many")),
        (120, 3, "second_pass"),
    ],
)
def test_those_of_direct_are_too(architecture: int, channels: int, kernel: str) -> None:
    defined = {
        "EVS_CHANNELS": channels,
        "EVS_ADAPTIVE": int(kernel == "second_pass"),
        "EVS_MANY": int(kernel == "direct_of_many"),
    }
    ptx = compiled("direct", f"compute_{architecture}", defined).decode()
    assert f".entry {kernel}(" in ptx
    assert faults(ptx) == []


@pytest.mark.slow
def test_those_of_path_are_too() -> None:
    ptx = compiled("path", "compute_80").decode()
    assert ".entry add_samples" in ptx
    assert faults(ptx) == []


@pytest.mark.slow
def test_those_of_hybrid_are_too() -> None:
    ptx = compiled("hybrid", "compute_75", {"EVS_CHANNELS": 1, "EVS_ADAPTIVE": 0}).decode()
    assert ".entry offer_readers" in ptx
    assert faults(ptx) == []


def test_other_instructions_are_found() -> None:
    options = [o for o in SAME_BYTES if not o.startswith(("--fmad", "--ftz", "--prec"))]
    careless = ("--fmad=true", "--prec-div=false", "--prec-sqrt=false", "--ftz=false")
    found = " ".join(faults(compiled("math", "compute_90", None, (*options, *careless)).decode()))
    assert "fma.rn.f32" in found
    assert "div.approx.f32" in found or "div.full.f32" in found
    assert "sqrt.approx.f32" in found
    assert "mul.f32" in found or "mul.rn.f32" in found
