"""The controller in docs/reference/lockstep.md, in C++: as it stands there it controls a loop."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from lockstep_stand_in import StandIn, serving

from reference.cpp_client import build

pytestmark = pytest.mark.integration

PAGE = Path(__file__).parents[3] / "docs/reference/lockstep.md"


def test_a_controller_in_another_language_decides_what_ours_would(tmp_path: Path) -> None:
    controller = build(PAGE, tmp_path)
    there, here = StandIn(("push",)), StandIn(("push",))
    there.last_tick = 80
    with serving(there) as server:
        words = [str(controller), server.address, "1000"]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
        # it leaves without a good-bye
        again = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert again.returncode == 1
    assert again.stderr.startswith("every seat is taken: 1 of 1 controllers are here")
    seen, force = here.reset(1), 0.0
    for _ in range(80):
        events = [packet.events["x"] for packet in seen.packets if len(packet)]
        if events:
            force = -float(np.mean(np.concatenate(events) - 64.0)) / 128.0
        seen = here.step([force])
    assert np.allclose([entry[1] for entry in there.log[1:]], [entry[1] for entry in here.log[1:]])
    assert np.allclose(np.array(done.stdout.split(), float), [seen.position[0], force])
