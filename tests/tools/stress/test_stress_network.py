"""The extremes of the network, at full length; `evs doctor` runs their short form."""

from __future__ import annotations

import pytest

from evs.tools.stress import Extreme, extremes_of, try_extreme

pytestmark = pytest.mark.extremes


@pytest.mark.slow
@pytest.mark.parametrize("extreme", extremes_of("network"), ids=lambda extreme: extreme.name)
def test_an_extreme_of_the_network_keeps_its_bound(extreme: Extreme) -> None:
    tried = try_extreme(extreme)
    assert tried.holds, tried
