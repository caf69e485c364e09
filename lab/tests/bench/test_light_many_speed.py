"""Time of a traced frame against the number of geoms and of lamps, with each instruction set."""

from __future__ import annotations

import pytest

from evs.emulator.base.features import Switches
from speed.many import hall, many_geoms
from speed.turns import Table, Time, milliseconds, target
from speed.view import FRAME, WIDE, Rays, View, share_of_the_same_geoms

RAYS = "mj_multiRay, primary rays"
GEOMS = (10, 100, 1000, 4000)
SCAN = Switches(off=frozenset({"hierarchy", "light_reach"}))


def times_of(view: View, camera_rays: Rays) -> dict[str, Time]:
    assert share_of_the_same_geoms(view, camera_rays) > 0.995
    return milliseconds(
        {
            RAYS: view.multi_ray(camera_rays),
            "direct, a scan of all": view.light(1, switches=SCAN),
            "path, a scan of all": view.light(1, switches=SCAN, renderer="path"),
            "direct, no shadows": view.light(1, shadows=False),  # type: ignore[arg-type]
        }
        | {f"direct, {isa}": view.light(1, isa=isa) for isa in WIDE}
        | {f"path, {isa}": view.light(1, renderer="path", isa=isa) for isa in WIDE},
        rounds=7,
    )


def show(title: str, columns: dict[str, dict[str, Time]], bounds: dict[str, float]) -> None:
    """Print the table, and the time of each column as a multiple of the first one's."""
    first = next(iter(columns))
    rows = [row for row in columns[first] if row != RAYS]
    print(
        Table(f"{title}, {FRAME}; 1 sample a pixel, 1 thread", columns, dict.fromkeys(rows, RAYS))
    )
    for row in (f"{light}, {isa}" for light in ("direct", "path") for isa in WIDE):
        for column, bound in bounds.items():
            factor = columns[column][row].median / columns[first][row].median
            print(target(f"{row}: {column}, against {first},", factor, bound, "times"))


@pytest.mark.bench
def test_many_geoms(camera_rays: Rays) -> None:
    columns = {f"{n} geoms": times_of(many_geoms(n), camera_rays) for n in GEOMS}
    show("many geoms", columns, {"1000 geoms": 3, "4000 geoms": 5})


@pytest.mark.bench
def test_many_lamps(camera_rays: Rays) -> None:
    columns = {f"{n} lamps": times_of(hall(n), camera_rays) for n in (5, 100)}
    show("five lamps, and a hundred of which five reach a place", columns, {"100 lamps": 2})
