"""The pytest plugin: the fixture evs_loop. The only module that imports pytest.

`-p evs` and `-p evs.tools.testing.plugin` load it. The latter imports nothing else of evs until a
test requests the fixture; with `-p evs`, pytest inspects every name of evs, which imports them all.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from evs.tools.testing.runner import LoopRunner


@pytest.fixture
def evs_loop(tmp_path: Path) -> LoopRunner:
    """Run a controller against a scene; returns a Run, which checks claims about the loop.

    run = evs_loop("cart.xml", Balancer, cameras="onboard", seconds=5.0, seeds=range(3))
    run.settles("angle", within=0.05, after_s=1.0)

    The episodes of failed claims are written to tmp_path, where they can be replayed.
    """
    from evs.tools.testing.runner import LoopRunner

    return LoopRunner(tmp_path)
