"""Many geoms and many lights: what culls them changes no byte."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.features import Switches
from evs.emulator.config import RenderConfig
from evs.emulator.render import make_renderer
from reference.random_scenes import RandomStage

pytestmark = pytest.mark.property

BOTH = frozenset({"hierarchy", "light_reach"})
SCAN, CULL = Switches(off=BOTH), Switches(on=BOTH)
LIGHTS = {
    "direct": {},
    "adaptive": {"antialiasing": "adaptive", "spp": 4},
    "path": {"renderer": "path"},
}


def check(seed: int, ticks: int, render: dict[str, object], **stage: object) -> None:
    """Render a film with and without what culls, incrementally or not."""
    scene = RandomStage(seed, rich=seed % 2 == 1, **stage)  # type: ignore[arg-type]
    config = RenderConfig(**{"spp": 1, **scene.render, **render})  # type: ignore[arg-type]
    scan, culled, kept = (
        make_renderer(
            scene.scene, scene.camera, replace(config, incremental=incremental), 1, switches=how
        )
        for how, incremental in ((SCAN, False), (CULL, False), (CULL, True))
    )
    pixels = np.array([(3, 4), (40, 29), (20, 0)], np.int32)
    for tick, (frame, pose) in enumerate(scene.film(ticks)):
        light = scan.render(frame, pose)
        assert culled.render(frame, pose).tobytes() == light.tobytes(), tick
        assert kept.render(frame, pose).tobytes() == light.tobytes(), tick
        traced = culled.trace(frame, pose, pixels)  # type: ignore[attr-defined]
        assert traced.tobytes() == light[pixels[:, 1], pixels[:, 0]].tobytes()
    on = [(r.features["hierarchy"], r.features["light_reach"]) for r in (scan, culled)]
    assert on == [(False, False), (True, True)]


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 12))]
)
def test_random_scenes(seed: int, light: str) -> None:
    check(seed, 3, LIGHTS[light], many=150 + 60 * seed, lights=5 + 3 * (seed % 5))


@pytest.mark.slow
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize(("decades", "zoom"), [(6.0, 1.0), (2.0, 300.0)])
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(2, 8))]
)
def test_more_random_scenes(seed: int, decades: float, zoom: float, light: str) -> None:
    stage = {"many": 5000 if seed == 0 else 400, "lights": 40, "decades": decades, "zoom": zoom}
    check(100 + seed, 4, LIGHTS[light], **stage)


@pytest.mark.parametrize("light", ["direct", "path"])
def test_geoms_that_fly_apart_and_poses_that_are_not_finite(light: str) -> None:
    scene = RandomStage(3, many=300, lights=6)
    config = RenderConfig(spp=1, incremental=False, **LIGHTS[light])  # type: ignore[arg-type]
    scan, culled = (
        make_renderer(scene.scene, scene.camera, config, 1, switches=how) for how in (SCAN, CULL)
    )
    rest = scene.geom_pos.copy()
    for spread in (1.0, 3.0, 1e3, 1e-3, 1.0):
        scene.geom_pos = rest * spread
        scene.geom_pos[7], scene.geom_pos[8, 1], scene.geom_pos[9] = np.nan, np.inf, 1e25
        frame = scene.snapshot()
        light_of = [r.render(frame, scene.pose).tobytes() for r in (scan, culled)]
        assert light_of[0] == light_of[1], spread
