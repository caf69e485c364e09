"""The wheel of evs-lab holds its package alone; .ci/audit_wheel.py checks the wheel of evs."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


@pytest.mark.slow
def test_that_of_evs_lab_holds_its_package_alone(
    checkout: Path, files: list[str], tmp_path: Path
) -> None:
    words = ["wheel", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    built = subprocess.run(
        [sys.executable, "-m", "pip", *words, "-w", str(tmp_path), str(checkout / "lab")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (found,) = tmp_path.iterdir()
    held = {name for name in zipfile.ZipFile(found).namelist() if ".dist-info/" not in name}
    assert held == {
        f"evs_{name}"
        for name in files
        if name.startswith("lab/") and name.endswith(".py") and not name.startswith("lab/tests/")
    }
