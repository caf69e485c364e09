"""Repair: the report on a recording that was repaired in place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Repair:
    """What repair did to a file."""

    path: Path
    cut_bytes: int
    """bytes cut from the end; 0: there was no torn tail"""
    cut_at: int
    """size of the file now, bytes"""
    pointer_reset: bool
    """the header pointed to a data table that is not there"""
    done: str = ""
    """what else was done, in words"""

    @property
    def needed(self) -> bool:
        """Whether anything was changed."""
        return bool(self.cut_bytes) or self.pointer_reset or bool(self.done)

    def __str__(self) -> str:
        """One line for people."""
        if not self.needed:
            return f"{self.path} needs no repair"
        done = []
        if self.cut_bytes:
            done.append(f"cut {self.cut_bytes} bytes at offset {self.cut_at}")
        if self.pointer_reset:
            done.append("removed the pointer to a missing data table")
        if self.done:
            done.append(self.done)
        return f"{self.path}: {' and '.join(done)}; every whole packet is kept"
