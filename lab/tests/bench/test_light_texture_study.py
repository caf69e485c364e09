"""What reading images along what a pixel covers of them does for events: a fast orbit around robots
on checkered floors, half a turn a second, against 64 samples a pixel.

lab/docs/sampling.md has the table of
`.venv/bin/pytest -m bench -s lab/tests/bench/test_light_texture_study.py`.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from evs.msgs import Events
from evs_lab.metrics.compare import Comparison
from reference.film import VIEWS
from reference.judged_film import JudgedFilm

WIDTH, HEIGHT, TICKS = 116, 87, 61
OFF = Switches(off=frozenset({"texture_filter"}))
WAYS = {f"fixed {spp}": RenderConfig(antialiasing="fixed", spp=spp) for spp in (1, 4)}


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("name", ["gymnasium/humanoid", "dm_control/humanoid"])
def test_events_of_an_orbit(name: str, robot_files: dict[str, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot_files[name]))
    film = JudgedFilm(model, "orbit", WIDTH, HEIGHT, TICKS, VIEWS[name])

    def shoot(config: RenderConfig, switches: Switches) -> Events:
        renderer = NativeRenderer(film.scene, film.camera, config, 1, switches=switches)
        return film.events_by(renderer)[0]

    def line(c: Comparison) -> str:
        return f"EMD {c.emd:6.3f}  recall {c.recall:.2f}  precision {c.precision:.2f}  {c.events}"

    truth = shoot(RenderConfig(antialiasing="fixed", spp=64), OFF)
    silence = film.compare(truth[:0], truth).emd
    print(f"\n{name}: {len(truth)} events of 64 samples; no event at all: EMD {silence:.3f}")
    emd = {}
    for way, config in WAYS.items():
        for filtered, switches in {"filtered": UNFORCED, "as before": OFF}.items():
            c = film.compare(shoot(config, switches), truth)
            emd[way, filtered] = c.emd
            print(f"  {way:12} {filtered:10} {line(c)}", flush=True)
        assert emd[way, "filtered"] < emd[way, "as before"]
    # one sample that is filtered is worth more than four that are not, where textures make events
    if name == "gymnasium/humanoid":
        assert emd["fixed 1", "filtered"] < emd["fixed 4", "as before"]
