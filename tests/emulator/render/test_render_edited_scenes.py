"""Edits mid-run: what is traced incrementally is what would be traced whole, bit for bit."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator import _core
from evs.emulator.config import RenderConfig, SensorConfig
from reference.edited import LARGE, SMALL, stage

pytestmark = pytest.mark.property

EDITS, SIZE = 100, SensorConfig("ideal", width=29, height=22)
WAYS = {
    "direct": RenderConfig(spp=2, antialiasing="adaptive", fog=True, haze=True),
    "path": RenderConfig(renderer="path", spp=2, bounces=2),
}


def colours(model: mujoco.MjModel, rng: np.random.Generator) -> None:
    """A few numbers of a random row, among those that randomised domains change."""
    name = rng.choice(
        ["geom_rgba", "mat_rgba", "light_diffuse", "geom_pos", "light_pos", "cam_pos"]
    )
    rows = getattr(model, name)
    row = rng.integers(len(rows))
    if name.endswith("pos"):
        rows[row] += rng.normal(size=3) * 0.02
    else:
        rows[row, :3] = rng.random(3)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("way", WAYS)
def test_the_incremental_trace_is_the_full_one_under_a_hundred_edits(way: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, data = stage()
    isa = _core.isa_available()[seed % len(_core.isa_available())]
    full, kept = (
        evs.EventCamera(
            model,
            "eye",
            sensor=SIZE,
            render=RenderConfig(**{**vars(WAYS[way]), "incremental": incremental, "isa": isa}),
            threads=1 + seed,
        )
        for incremental in (False, True)
    )
    begin = {name: getattr(model, name).copy() for name in ("geom_rgba", "geom_group", "geom_pos")}
    shares, edited = [], 0
    while edited < EDITS:
        if rng.random() < 0.7:
            edit = rng.choice(["one", "one", "large", "numbers"])
            if edit == "numbers":
                colours(model, rng)
            else:
                choices = SMALL if edit == "one" else LARGE
                choices[str(rng.choice(list(choices)))](model)
            if edit == "large":
                for sensor in (full, kept):
                    sensor.refresh()
            edited += 1
        if edited % 10 == 9:
            # edits of one sort would leave nothing to be seen in the end
            for name, values in begin.items():
                getattr(model, name)[:] = values
        mujoco.mj_step(model, data)
        events = [sensor.observe(data).tobytes() for sensor in (full, kept)]
        assert full.luminance.tobytes() == kept.luminance.tobytes(), (seed, edited)
        assert events[0] == events[1], (seed, edited)
        shares.append(kept._camera.traced_fraction)
        if edited % 20 == 0:
            # nothing of what was before is left in it either
            anew = evs.EventCamera(model, "eye", sensor=SIZE, render=WAYS[way], threads=1)
            anew.observe(data)
            assert anew.luminance.tobytes() == kept.luminance.tobytes(), (seed, edited)
    # some ticks were whole, others were not
    assert 1.0 in shares
    assert min(shares) < 0.9
    assert kept.rebuilt["scenes"] > 20
