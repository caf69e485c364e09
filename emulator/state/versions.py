"""Versions of what shapes the events."""

from __future__ import annotations

import numpy as np

from evs.emulator.world import MUJOCO_VERSION


def versions() -> dict[str, str]:
    """Versions of everything that shapes the events."""
    from evs import __version__

    return {"evs": __version__, "mujoco": MUJOCO_VERSION, "numpy": np.__version__}
