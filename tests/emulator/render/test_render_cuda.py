"""The kernels of one lane as code for GPUs: no fma, nothing approximate, denormals flushed.

Needs NVRTC (`pip install nvidia-cuda-nvrtc cuda-bindings`), but no GPU.
"""

from __future__ import annotations

import re

import pytest

nvrtc = pytest.importorskip("cuda.bindings.nvrtc", reason="no NVRTC: pip install cuda-bindings")
try:
    nvrtc.nvrtcVersion()
except RuntimeError as error:
    pytest.skip(f"no NVRTC: {error}", allow_module_level=True)

from tests.support.cuda.compile import SAME_BYTES, compiled  # noqa: E402

ARITHMETIC = re.compile(r"\b(?:add|sub|mul|div|sqrt|min|max|abs|neg|setp)\.[\w.]*f32\b")
OTHER_ROUNDING = re.compile(r"\b(?:fma|mad\.r\w|\w+\.approx)[\w.]*")


def faults(ptx: str) -> list[str]:
    """Instructions that a CPU has no equal for."""
    unlike = [word for word in ARITHMETIC.findall(ptx) if ".ftz" not in word]
    return sorted({*unlike, *OTHER_ROUNDING.findall(ptx)})


@pytest.mark.parametrize("architecture", [75, 80, 90, 120])
@pytest.mark.parametrize("kernel", ["math", "rays", "comparator"])
def test_instructions_are_those_of_a_cpu(kernel: str, architecture: int) -> None:
    ptx = compiled(kernel, f"compute_{architecture}").decode()
    assert f".target sm_{architecture}" in ptx
    assert len(re.findall(r"\b(?:add|mul)\.[\w.]*f(?:32|64)\b", ptx)) > 5
    assert faults(ptx) == []


def test_other_instructions_are_found() -> None:
    options = [o for o in SAME_BYTES if not o.startswith(("--fmad", "--ftz", "--prec"))]
    careless = ("--fmad=true", "--prec-div=false", "--prec-sqrt=false", "--ftz=false")
    found = " ".join(faults(compiled("math", "compute_90", (*options, *careless)).decode()))
    assert "fma.rn.f32" in found
    assert "div.approx.f32" in found or "div.full.f32" in found
    assert "sqrt.approx.f32" in found
    assert "mul.f32" in found or "mul.rn.f32" in found
