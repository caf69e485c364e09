"""The one error that users see: a single line that includes the fix."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class EvsError(Exception):
    """An error that the user can fix. The message is one line with the problem and the fix.

    Every command prints it to stderr and ends with exit code 2, without a traceback.
    """


def unknown(kind: str, name: str, known: Iterable[str]) -> EvsError:
    """The error for a name that does not exist.

    Args:
        kind: What the name should be, such as "topic".
        name: The name.
        known: The names that exist; the message lists them, the most similar first.
    """
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
