"""See every physics step that a library takes, wherever it takes it.

Libraries step MuJoCo by `mujoco.mj_step` and `mujoco.mj_step2`, often several times in one call.
From the first use on these names are functions that call MuJoCo's and then whoever watches the
data; other data pass through.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
from mujoco import MjData, MjModel

_watchers: dict[int, list[Callable[[], None]]] = {}
"""id of a MjData -> called after each of its steps, in this order"""

_step, _step2 = mujoco.mj_step, mujoco.mj_step2


def mj_step(m: MjModel, d: MjData, nstep: int = 1) -> None:
    """MuJoCo's mj_step, which tells who watches the data."""
    watchers = _watchers.get(id(d))
    if watchers is None:
        _step(m, d, nstep)
        return
    for _ in range(nstep):
        _step(m, d)
        for watcher in watchers:
            watcher()


def mj_step2(m: MjModel, d: MjData) -> None:
    """MuJoCo's mj_step2, which tells who watches the data."""
    _step2(m, d)
    for watcher in _watchers.get(id(d), ()):
        watcher()


@contextmanager
def watching(data: MjData, watcher: Callable[[], None]) -> Iterator[None]:
    """Call `watcher` after each physics step of the data, while this is open. It may be nested."""
    mujoco.mj_step, mujoco.mj_step2 = mj_step, mj_step2
    watchers = _watchers.setdefault(id(data), [])
    watchers.append(watcher)
    try:
        yield
    finally:
        watchers.remove(watcher)
        if not watchers:
            del _watchers[id(data)]
