"""Where the user's cache folder is."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """The folder evs/NAME in XDG_CACHE_HOME or ~/.cache; it may not exist yet."""
    configured = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(configured) if Path(configured).is_absolute() else Path.home() / ".cache"
    return home / "evs" / name
