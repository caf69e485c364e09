"""Counter: a subscriber in its own process that counts what arrives."""

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
    """`evs echo ADDRESS --quiet --json` as a context: started on entry, gone on exit.

    An EvsError inside the block is replaced by what ended the process, if that died before: a
    publisher that waited in vain does not know the reason.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def __enter__(self) -> Counter:
        self._folder = tempfile.TemporaryDirectory()
        self._file = Path(self._folder.name) / "counted.json"
        self._complaints = Path(self._folder.name) / "complaints.txt"
        command = [sys.executable, "-P", "-m", "evs.launch.main", "echo", self.address, "--quiet"]
        with self._complaints.open("w") as complaints:
            self._process = subprocess.Popen(
                [*command, "--timeout", f"{SILENCE_S:g}", "--json", str(self._file)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
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
        try:
            if isinstance(error, EvsError):
                self._raise_if_failed()
        finally:
            self._process.kill()
            self._process.wait()
            self._folder.cleanup()

    def totals(self) -> dict[str, Any]:
        """Wait for its end; what it counted. EvsError where it failed or does not end."""
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise EvsError(
                f"the subscriber of {self.address} does not end: try again with fewer programs "
                "running"
            ) from None
        self._raise_if_failed()
        counted: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
        return counted

    def _raise_if_failed(self) -> None:
        code = self._process.poll()
        if code:
            lines = self._complaints.read_text(errors="replace").strip().splitlines()
            reason = lines[-1].removeprefix("evs: ") if lines else f"exit code {code}"
            raise EvsError(f"the subscriber's process failed: {reason}") from None
