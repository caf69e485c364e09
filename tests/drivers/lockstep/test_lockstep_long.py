"""Many steps over the wire: nothing is kept of them, on either side."""

from __future__ import annotations

import pytest
from lockstep_stand_in import StandIn, serving

from evs.drivers.lockstep import connect
from reference.memory import LEAST_BYTES, resident_bytes

pytestmark = pytest.mark.integration

STEPS = 50_000
"""As many as 50 s of a loop at 1 kHz have."""
WARM = 10_000


class Forgetful(StandIn):
    """Notes nothing."""

    @property
    def log(self) -> list[tuple[object, ...]]:
        return []

    @log.setter
    def log(self, _: list[tuple[object, ...]]) -> None:
        pass


@pytest.mark.slow
def test_memory_stays_over_many_steps() -> None:
    with serving(Forgetful()) as server, connect(server.address) as loop:
        loop.reset(1)
        for _ in range(WARM):
            loop.step([0.1, 0.2])
        before = resident_bytes()
        for _ in range(STEPS):
            seen = loop.step([0.1, 0.2])
        assert seen.t_us == 1000 * (WARM + STEPS)
        # both ends are in this process
        assert resident_bytes() - before < LEAST_BYTES * STEPS
        assert server.counts["steps"] == WARM + STEPS
