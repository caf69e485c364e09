"""PTX of kernels, searched for what a CPU has no equal for.

Needs NVRTC (`pip install nvidia-cuda-nvrtc cuda-bindings`), but no GPU: tests that import this are
skipped without it.
"""

from __future__ import annotations

import re

import pytest

nvrtc = pytest.importorskip("cuda.bindings.nvrtc", reason="no NVRTC: pip install cuda-bindings")
try:
    nvrtc.nvrtcVersion()
except RuntimeError as error:
    pytest.skip(f"no NVRTC: {error}", allow_module_level=True)

ARITHMETIC = re.compile(r"\b(?:add|sub|mul|div|sqrt|min|max|abs|neg|setp|fma)\.[\w.]*f32\b")
OTHER_ROUNDING = re.compile(r"\b(?:fma|mad\.r\w|\w+\.approx)[\w.]*")


def faults(ptx: str) -> list[str]:
    """Instructions that contract, approximate, or keep denormals of float32; every fma."""
    unlike = [word for word in ARITHMETIC.findall(ptx) if ".ftz" not in word]
    return sorted({*unlike, *OTHER_ROUNDING.findall(ptx)})
