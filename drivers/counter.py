"""A subscriber in a process of its own that counts what arrives."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

from evs.msgs import EvsError

PATIENCE_S = 30.0
"""How long the process may take to end after the stream has."""

SILENCE_S = 60.0
"""It ends by itself when nothing came for this long: no orphan is left behind."""


class Counter:
    """`evs echo ADDRESS --quiet --json` as a context: started on entry, gone on exit."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._folder = tempfile.TemporaryDirectory()
        self._file = Path(self._folder.name) / "counted.json"
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Counter:
        command = [sys.executable, "-m", "evs.launch.main", "echo", self.address, "--quiet"]
        self._process = subprocess.Popen(
            [*command, "--timeout", f"{SILENCE_S:g}", "--json", str(self._file)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            # Ctrl-C is for the publisher; this process ends when the stream does
            start_new_session=True,
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.communicate()
        self._folder.cleanup()

    def totals(self) -> dict[str, Any]:
        """Wait for its end; what it counted. EvsError where it failed or does not end."""
        assert self._process is not None
        try:
            _, said = self._process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise EvsError(
                f"the subscriber of {self.address} does not end: try again with fewer programs "
                "running"
            ) from None
        if self._process.returncode:
            lines = said.strip().splitlines() or [f"exit code {self._process.returncode}"]
            raise EvsError(f"the subscriber failed: {lines[-1].removeprefix('evs: ')}")
        counted: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
        return counted
