"""Where modules are found, for processes that this one starts."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path


def search_path() -> str:
    """The value of PYTHONPATH with which another process finds the same modules as this one."""
    found = []
    for entry in sys.path:
        # a relative one leads nowhere if the working folder was deleted
        with suppress(FileNotFoundError):
            found.append(str(Path(entry).absolute()))
    return os.pathsep.join(found)
