"""Paths inside an installed Python package, and the user's cache folder."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path

from evs.msgs import EvsError


def package_of(text: str) -> re.Match[str] | None:
    """The two sides of `package:path`; None where it is another path."""
    # two letters or more, so that a drive letter is none; no slash after the colon, so no URL is
    return re.fullmatch(r"([A-Za-z_]\w+):([^/\\:].*)", text)


def beside(file: Path, text: str) -> str:
    """A path that stands in a file: relative to that file."""
    return text if package_of(text) or text[:1] == "~" else str(file.parent / text)


def in_package(text: str) -> str:
    """`package:path` as a path: a file that an installed Python package ships; `~` is the home.

    Raises:
        EvsError: There is no such package.
    """
    found = package_of(text)
    if found is None or Path(text).exists():
        return str(Path(text).expanduser()) if text[:1] == "~" else text
    spec = importlib.util.find_spec(found[1])
    folders = list(spec.submodule_search_locations or ()) if spec else []
    if not folders:
        raise EvsError(f"'{text}': no Python package '{found[1]}' here; pip install {found[1]}")
    return str(Path(folders[0]) / found[2])


def cache_folder(name: str) -> Path:
    """The folder evs/NAME in XDG_CACHE_HOME or ~/.cache; it may not exist yet."""
    configured = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(configured) if Path(configured).is_absolute() else Path.home() / ".cache"
    return home / "evs" / name
