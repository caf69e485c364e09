"""Where a run is. In a file of its own: who shows it needs no world, and not MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Where a run is, after a tick."""

    tick: int
    """ticks done"""
    ticks: int
    """ticks wanted"""
    sim_seconds: float
    events: int
    """so far"""
    wall_seconds: float
    """so far"""
