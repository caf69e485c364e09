"""Training of networks: data from traced light, and what is learnt from it."""

from __future__ import annotations

import importlib.util

from evs.msgs import EvsError


def need_jax() -> None:
    """Raises EvsError where the extra `train` is not installed."""
    missing = [name for name in ("jax", "optax") if importlib.util.find_spec(name) is None]
    if missing:
        raise EvsError(f"training needs {' and '.join(missing)}: pip install 'evs[train]'")
