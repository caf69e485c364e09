"""What `pytest -p evs` loads: the fixture evs_loop. The only door to pytest.

`-p evs.tools.testing.plugin` loads the same and imports nothing else of evs before a test asks
for the fixture; under `-p evs` pytest looks at every name of evs, which imports them all.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from evs.tools.testing.runner import LoopRunner


@pytest.fixture
def evs_loop(tmp_path: Path) -> LoopRunner:
    """Run a controller against a scene; what comes back says what holds of the loop.

    run = evs_loop("cart.xml", Balancer, cameras="onboard", seconds=5.0, seeds=range(3))
    run.settles("angle", within=0.05, after_s=1.0)

    Of what fails, controls, pushes and events stay in the test's tmp_path, to be run again.
    """
    from evs.tools.testing.runner import LoopRunner

    return LoopRunner(tmp_path)
