"""A venv of its own for another project's program, so that its licence and its pins stay there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from speed.elsewhere import AbsentError

MISSING = "{} cannot be installed ({}): go online once, or make the venv build/venvs/{} by hand"


def python_with(checkout: Path, package: str, *others: str) -> Path:
    """The Python of build/venvs/PACKAGE, made on first use with the versions of our pins.

    Raises AbsentError where that cannot be.
    """
    folder = checkout / "build" / "venvs" / package
    python, done = folder / "bin" / "python", folder / "installed"
    if not done.exists():
        pins = (checkout / ".ci/constraints.txt").read_text().splitlines()
        pinned = [line for line in pins if line.split("==")[0].lower() in {package, *others}]
        try:
            for words in (
                [sys.executable, "-m", "venv", str(folder)],
                [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", *pinned],
            ):
                subprocess.run(words, capture_output=True, text=True, check=True)
        except subprocess.CalledProcessError as failed:
            reason = (failed.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise AbsentError(MISSING.format(package, reason, package)) from None
        done.touch()
    return python
