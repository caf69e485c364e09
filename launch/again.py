"""How to call evs again, so that a printed command works where it is copied to."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path


def program() -> str:
    """How evs was called, as short as it works from here."""
    called = Path(sys.argv[0])
    if called.name != "evs":
        return f"{shlex.quote(sys.executable)} -m evs.launch.main"
    found = shutil.which("evs")
    if found is not None and Path(found).samefile(called):
        return "evs"
    return shlex.quote(sys.argv[0])


def command(*words: str | Iterable[str]) -> str:
    """A whole line for a shell: evs with these words, each quoted where a shell would split it."""
    flat = [part for word in words for part in ([word] if isinstance(word, str) else word)]
    return f"{program()} {shlex.join(flat)}"
