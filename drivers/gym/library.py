"""Imports Gymnasium, or raises one line on how to install it. The only module that does."""

from __future__ import annotations

from evs.msgs import EvsError

try:
    import gymnasium
    from gymnasium import spaces, vector
    from gymnasium.utils import seeding
except ImportError:
    raise EvsError("Gymnasium is not installed: pip install 'evs[gym]'") from None

__all__ = ["gymnasium", "seeding", "spaces", "vector"]
