"""Random scenes by `path`: the same bytes on any instruction set and number of threads."""

from __future__ import annotations

import pytest

from reference.random_scenes import check_film

pytestmark = pytest.mark.property


def paths(seed: int) -> dict[str, object]:
    """Settings of `path`: any number of bounces, every sampler, fixed and fresh seeds."""
    sampler = ("owen", "sobol", "global", "random", "anchored")[seed % 5]
    seeds = ("fixed", "fresh")[seed // 5 % 2]
    return {"renderer": "path", "bounces": seed % 6, "sampler": sampler, "seeds": seeds}


@pytest.mark.parametrize(
    ("decades", "zoom"),
    [
        (1.0, 1.0),
        *(
            pytest.param(*way, marks=pytest.mark.slow)
            for way in ((6.0, 1.0), (1.0, 300.0), (1.0, 0.01))
        ),
    ],
)
def test_paths_are_the_same_however_they_were_traced(decades: float, zoom: float) -> None:
    check_film(range(24), 3, paths, decades=decades, zoom=zoom)


def test_paths_among_physical_materials_in_fog_are_the_same() -> None:
    check_film(range(24), 3, paths, rich=True)


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.parametrize(("decades", "zoom"), [(1.0, 1.0), (6.0, 1.0), (3.0, 0.03)])
def test_paths_are_the_same_in_many_scenes(decades: float, zoom: float) -> None:
    check_film(range(7000, 7120), 4, paths, decades=decades, zoom=zoom)
