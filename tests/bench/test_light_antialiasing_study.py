"""Which antialiasing serves an event camera: events of each against those of 256 samples a pixel.

Robots of gymnasium and dm_control; a camera that stands still, pans at 170 px/s or slides at half
a metre a second. It takes a quarter of an hour, so `make bench` leaves it out. The table of
docs/explanation/light.md is from
`.venv/bin/pytest -m bench -s tests/bench/test_light_antialiasing_study.py`.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from evs.emulator.config import RenderConfig
from evs.emulator.render import DirectRenderer
from evs.msgs import Events
from reference.film import Film

WIDTH, HEIGHT, TICKS = 173, 130, 81
SCENES = ["gymnasium/humanoid", "dm_control/humanoid", "dm_control/cartpole",
          "dm_control/quadruped"]  # fmt: skip
MODES = {
    "fixed 1": RenderConfig(antialiasing="fixed", spp=1),
    "fixed 4": RenderConfig(antialiasing="fixed", spp=4),
    "fixed 16": RenderConfig(antialiasing="fixed", spp=16),
    "adaptive 4": RenderConfig(antialiasing="adaptive", spp=4),
    "adaptive 8": RenderConfig(antialiasing="adaptive", spp=8),
    "adaptive 16": RenderConfig(antialiasing="adaptive", spp=16),
}


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan", "slide"])
@pytest.mark.parametrize("name", SCENES)
def test_events_of_each_antialiasing(name: str, motion: str, robot_files: dict[str, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot_files[name]))
    film = Film(model, motion, WIDTH, HEIGHT, TICKS)

    def shoot(config: RenderConfig) -> tuple[Events, float]:
        return film.events_by(DirectRenderer(film.scene, film.camera, config, 1))

    truth, _ = shoot(RenderConfig(antialiasing="fixed", spp=256))
    print(f"\n{name}, {motion}: {len(truth)} events of 256 samples")
    emd = {}
    for mode, config in MODES.items():
        events, ms = shoot(config)
        c = film.compare(events, truth)
        emd[mode] = c.emd
        print(
            f"  {mode:12} EMD {c.emd:8.4f}  recall {c.recall:.3f}  precision {c.precision:.3f}"
            f"  {ms:6.2f} ms"
        )
    if len(truth) > 1000:
        assert emd["adaptive 16"] < emd["fixed 4"]
