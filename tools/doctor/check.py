"""Check: one line of evs doctor, with a verdict and a fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

OK, NOTE, BAD = "ok", "note", "bad"
"""works; works, but worth knowing; must be fixed before evs works here"""


@dataclass(frozen=True)
class Check:
    """The result of one check."""

    name: str
    verdict: str
    """OK, NOTE or BAD"""
    says: str
    """what was found, one line"""
    fix: str = ""
    """what to do, one line; never empty if the verdict is BAD"""


def guarded(name: str, fix: str, check: Callable[[], list[Check]]) -> list[Check]:
    """Run a check; an exception becomes a check with the verdict BAD.

    Args:
        name: of the check, if it raises.
        fix: what to do then.
        check: the check.
    """
    try:
        return check()
    except Exception as reason:
        words = " ".join(str(reason).split()) or type(reason).__name__
        return [Check(name, BAD, words, fix)]
