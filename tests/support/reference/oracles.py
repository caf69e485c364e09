"""Other people's readers and writers as a program beside a test."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from evs.msgs import Events

ORACLES_PYTHON = Path(sys.prefix, "oracles", "bin", "python")
"""Of the environment that .ci/setup.sh makes for oracles under the GPL."""


class OracleProgram:
    """A script that prints a line of JSON for each file, and whose `digest` sums up events."""

    def __init__(self, script: Path, python: str | Path = sys.executable) -> None:
        self.script, self.python = script, python

    def __call__(self, *words: object) -> list[dict[str, Any]]:
        """What it prints for each file."""
        done = subprocess.run(
            [self.python, self.script, *map(str, words)],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]

    def digest(self, events: Events) -> str:
        """The sum that it prints for files of these events."""
        spec = importlib.util.spec_from_file_location(self.script.stem, self.script)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found: str = module.digest(*(events[name] for name in "txyp"))
        return found
