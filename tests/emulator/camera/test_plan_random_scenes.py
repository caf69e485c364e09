"""Random scenes of everything a world can hold: all code paths on, the same light byte for byte."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.features import Switches
from evs.emulator.config import PlanConfig, RenderConfig
from evs.emulator.render import make_renderer
from reference.random_scenes import RandomStage

pytestmark = pytest.mark.property

ALL = Switches.of(PlanConfig(everything=True))


def check(seeds: range, ticks: int, render: dict[str, object], **stage: object) -> int:
    """How many code paths were on that the scenes did not need."""
    idle = 0
    for seed in seeds:
        scene = RandomStage(seed, **stage)  # type: ignore[arg-type]
        isa = _core.isa_available()[seed % len(_core.isa_available())]
        chosen = {"spp": (1, 2, 4, 5)[seed % 4], "isa": isa, **scene.render, **render}
        config = RenderConfig(**chosen)  # type: ignore[arg-type]
        bare = make_renderer(scene.scene, scene.camera, config, 1)
        full = make_renderer(scene.scene, scene.camera, config, 1, switches=ALL)
        for tick, (frame, pose) in enumerate(scene.film(ticks)):
            light = bare.render(frame, pose)
            assert full.render(frame, pose).tobytes() == light.tobytes(), (seed, tick)
            # single pixels go the same ways
            pixels = np.array([(3, 4), (40, 29), (20, 0)], np.int32)
            if hasattr(full, "trace"):
                traced = full.trace(frame, pose, pixels)
                assert traced.tobytes() == light[pixels[:, 1], pixels[:, 0]].tobytes()
        ours, theirs = bare.features, full.features
        assert all(theirs[name] for name, on in ours.items() if on)
        idle += sum(theirs[name] and not ours[name] for name in ours)
    return idle


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("rich", [False, True])
def test_direct(antialiasing: str, rich: bool) -> None:
    count = 40
    render: dict[str, object] = {"antialiasing": antialiasing}
    assert check(range(count), 5, render, rich=rich) > 4 * count


@pytest.mark.slow
@pytest.mark.parametrize("rich", [False, True])
def test_paths(rich: bool) -> None:
    assert check(range(24), 3, {"renderer": "path"}, rich=rich) > 3 * 24


@pytest.mark.slow
@pytest.mark.parametrize(("decades", "zoom"), [(6.0, 1.0), (1.0, 300.0)])
def test_many(decades: float, zoom: float) -> None:
    for renderer in ("direct", "path"):
        render: dict[str, object] = {"renderer": renderer}
        assert check(range(9000, 9060), 3, render, decades=decades, zoom=zoom, rich=True) > 0
