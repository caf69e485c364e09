"""The one error that users see: a single line with the fix in it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class EvsError(Exception):
    """Something the user can mend. The message is one line: what is wrong and what to do.

    Every program of ours prints it to stderr and ends with exit code 2, without a traceback.
    """


def unknown(kind: str, name: str, known: Iterable[str]) -> EvsError:
    """An error for a name that does not exist: says what exists, nearest first."""
    ordered = nearest_first(name, known)
    if not ordered:
        return EvsError(f"no {kind} '{name}': there are none")
    shown = ", ".join(ordered[:12]) + (", ..." if len(ordered) > 12 else "")
    return EvsError(f"no {kind} '{name}'; there is: {shown}")


def nearest_first(name: str, known: Iterable[str]) -> list[str]:
    """All known names, the most similar to `name` first, ties in alphabetical order."""

    def likeness(candidate: str) -> float:
        return difflib.SequenceMatcher(None, name.lower(), candidate.lower()).ratio()

    return sorted(known, key=lambda candidate: (-likeness(candidate), candidate))
