"""Threads and instruction sets."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from evs.tools.stress.machine.child import ProcessResult, emulate
from evs.tools.stress.machine.spinner import SPINNER, TABLES, differing, spun
from evs.tools.stress.stress_case import Measurement, StressCase

NO_AVX = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ",
    "NPY_DISABLE_CPU_FEATURES": "AVX AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL "
    "AVX512_ICL AVX512_SPR X86_V3 X86_V4",
}
"""environment: instructions that the C library and NumPy are not to use"""


def _threads(short: bool) -> Measurement:
    """One thread, two, and more than there are cores."""
    seconds = 0.02 if short else 0.2
    many = 4 * (os.cpu_count() or 1) + 1
    one, *others = (spun(seconds, {"threads": count}) for count in (1, 2, many))
    wrong = sum(differing(one.events, other.events) for other in others)
    return Measurement(
        wrong, 0, "other events", (f"{len(one.events):,} events with 1, 2, {many} threads",)
    )


def _portable(short: bool) -> Measurement:
    """All models and renderers on the portable path, beside the fastest that this machine has."""
    seconds = 0.01 if short else 0.05
    wrong, made = 0, 0
    for tables in _EVERYTHING:
        auto, portable = (
            spun(seconds, {**tables, "render": {**tables["render"], "isa": isa}})
            for isa in ("auto", "portable")
        )
        wrong += differing(auto.events, portable.events)
        made += len(auto.events)
    bare = _without_avx(seconds)
    auto = spun(seconds)
    wrong += differing(auto.events, bare.recorded)
    messages = f"{made + len(auto.events):,} events, each the same"
    return Measurement(wrong, 0, "other events", (messages,), bare.code == 0)


def _without_avx(seconds: float) -> ProcessResult:
    """A process in which NumPy and the C library do not use AVX either."""
    given = [f"sensor.{key}={value}" for key, value in TABLES["sensor"].items()]
    given += ["scene.keyframe=calm", "threads=1", "render.isa=portable", f"duration_s={seconds}"]
    with tempfile.TemporaryDirectory() as folder:
        return emulate(Path(folder), SPINNER, given, environment=NO_AVX)


_SMALL = {**TABLES["sensor"], "width": 24, "height": 18}
_EVERYTHING: tuple[dict[str, Any], ...] = (
    {"render": {}},
    {"render": {"renderer": "path", "spp": 4}, "model": {"name": "adaptive"}},
    {"render": {"spp": 1}, "model": {"name": "evsnet"}, "sensor": _SMALL},
)
"""what the portable path is tried with: direct and plain, path and adaptive, the network"""

CASES = (
    StressCase(
        "threads",
        "machine",
        "one thread, two, and four for each core and one more",
        "the same bytes",
        _threads,
    ),
    StressCase(
        "no-avx",
        "machine",
        "no AVX: renderers, pixels and network on the portable path; NumPy and the C library "
        "without it too",
        "the same bytes as on the fastest instruction set",
        _portable,
    ),
)
