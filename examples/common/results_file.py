"""ResultsFile: the results of a study, saved after each value, so that a study can be resumed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from evs.drivers.run.report import write_whole
from evs.msgs import EvsError


class ResultsFile:
    """Values by row and name, in a JSON file that is written atomically after every change."""

    def __init__(self, file: Path | None, plan: dict[str, Any]) -> None:
        """Read the file if it exists.

        Args:
            file: None: the values stay in memory.
            plan: settings of the study, plain data.

        Raises:
            EvsError: the file belongs to another plan, or is not such a file.
        """
        self._file = file
        self.plan = json.loads(json.dumps(plan))
        self.rows: dict[str, dict[str, Any]] = {}
        if file is None or not file.is_file() or not file.stat().st_size:
            return
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            plan_there, rows = data["plan"], {str(k): dict(v) for k, v in data["rows"].items()}
        except (ValueError, KeyError, TypeError, AttributeError, OSError):
            raise EvsError(f"'{file}' holds no results of a loop: give another file") from None
        if plan_there != self.plan:
            raise EvsError(f"'{file}' was made with other options: give them, or another file")
        self.rows = rows

    def has(self, row: str, name: str) -> bool:
        """Whether there is such a value."""
        return name in self.rows.get(row, {})

    def put(self, row: str, name: str, value: Any) -> None:
        """Set a value, plain data, and write the file."""
        self.rows.setdefault(row, {})[name] = value
        if self._file is not None:
            data = {"plan": self.plan, "rows": self.rows}
            write_whole(json.dumps(data, indent=2, allow_nan=False) + "\n", self._file)
