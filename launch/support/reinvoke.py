"""Format `evs` command lines that work when they are copied into the same shell."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path


def program() -> str:
    """The shortest command that starts this evs again."""
    called = Path(sys.argv[0])
    if called.name != "evs":
        return f"{shlex.quote(sys.executable)} -m evs"
    # uv (`uvx evs`) has put the folder of this evs into PATH for this process alone
    found = None if "UV" in os.environ else shutil.which("evs")
    if found is not None and Path(found).samefile(called):
        return "evs"
    return shlex.quote(sys.argv[0])


def command(*words: str | Iterable[str]) -> str:
    """A shell line: evs with these arguments, quoted where necessary."""
    flat = [part for word in words for part in ([word] if isinstance(word, str) else word)]
    return f"{program()} {shlex.join(flat)}"
