"""The committed type stub of the native core is the one that nanobind writes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_the_stub_is_up_to_date(checkout: Path, tmp_path: Path) -> None:
    written = tmp_path / "_core.pyi"
    subprocess.run(
        [sys.executable, "-m", "nanobind.stubgen"]
        + ["-q", "-m", "evs.emulator._core", "-o", str(written)],
        check=True,
    )
    assert (checkout / "emulator/_core.pyi").read_text() == written.read_text(), "run: make stubs"
