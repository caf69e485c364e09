"""Check: one line of a check-up, with its verdict and a fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

OK, NOTE, BAD = "ok", "note", "bad"
"""Well; well enough but worth knowing; must be mended before evs works here."""


@dataclass(frozen=True)
class Check:
    """The outcome of one look."""

    name: str
    verdict: str
    """OK, NOTE or BAD"""
    says: str
    """what was found, one line"""
    fix: str = ""
    """what to do, one line; never empty where the verdict is BAD"""


def guarded(name: str, fix: str, look: Callable[[], list[Check]]) -> list[Check]:
    """What `look` finds; whatever it raises is a finding too: a check-up must not break down."""
    try:
        return look()
    except Exception as reason:
        words = " ".join(str(reason).split()) or type(reason).__name__
        return [Check(name, BAD, words, fix)]
