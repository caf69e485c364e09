"""Which samples serve an event camera: events of `path` with few samples against converged light.

A room of soft light (a glowing ball, a bulb, an even sky, one mirror) with a pendulum in it; a
camera that stands still, pans at 170 px/s or slides at half a metre a second. The README's table is
from `.venv/bin/pytest -m bench -s tests/bench/test_light_noise_study.py`.
"""

from __future__ import annotations

import mujoco
import pytest

from evs.emulator.config import RenderConfig
from evs.emulator.light import make_renderer
from evs.msgs import Events
from reference.film import Film

WIDTH, HEIGHT, TICKS = 87, 65, 61
CONVERGED = 2048
ROOM = """<mujoco><statistic center="0 0 .7" extent="2"/>
    <visual><headlight ambient=".2 .2 .2" diffuse="0 0 0" specular="0 0 0"/></visual><asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".7 .6 .5" rgb2=".3 .35 .4"
             width="128" height="128"/>
    <material name="floor" texture="tiles" texrepeat="6 6" reflectance=".1"/>
    <material name="matt" rgba=".8 .4 .3 1" specular="0"/>
    <material name="gloss" rgba=".3 .5 .8 1" specular=".8" shininess=".6"/>
    <material name="lamp" rgba="1 1 .9 1" emission="6"/></asset><worldbody>
    <light type="point" pos="1.5 -1 2.5" attenuation="0 0 1" diffuse="2 2 2" bulbradius=".25"/>
    <geom type="plane" size="4 4 .1" material="floor"/>
    <geom type="sphere" pos="-1 .6 1.6" size=".25" material="lamp"/>
    <geom type="box" pos=".8 .6 .4" size=".3 .3 .4" euler="0 0 30" material="gloss"/>
    <body pos="0 0 1.5"><joint axis="0 1 0" ref="0"/><joint axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 .5 0 -.5" size=".05" material="matt"/>
      <geom type="sphere" pos=".5 0 -.5" size=".18" material="gloss"/></body>
    </worldbody></mujoco>"""
STRATEGIES = {
    "fresh, random": {"seeds": "fresh", "sampler": "random"},
    "fresh, owen": {"seeds": "fresh", "sampler": "owen"},
    "fixed, random": {"seeds": "fixed", "sampler": "random"},
    "fixed, global": {"seeds": "fixed", "sampler": "global"},
    "fixed, sobol": {"seeds": "fixed", "sampler": "sobol"},
    "fixed, owen": {"seeds": "fixed", "sampler": "owen"},
}


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan", "slide"])
def test_events_of_each_way_to_sample(motion: str) -> None:
    film = Film(mujoco.MjModel.from_xml_string(ROOM), motion, WIDTH, HEIGHT, TICKS)

    def shoot(seed: int, **render: object) -> Events:
        config = RenderConfig(**{"renderer": "path", **render})  # type: ignore[arg-type]
        renderer = make_renderer(film.scene, film.camera, config, 2, seed=seed)
        return film.events_by(renderer)[0]

    truth = shoot(1, spp=CONVERGED)
    own = film.compare(shoot(2, spp=CONVERGED), truth)
    print(f"\n{motion}: {len(truth)} events of {CONVERGED} samples; a second such run: EMD "
          f"{own.emd:.3f}, recall {own.recall:.3f}, precision {own.precision:.3f}")  # fmt: skip
    emd: dict[tuple[str, int], float] = {}
    for spp in (1, 4, 16, 64):
        for name, how in STRATEGIES.items():
            events = shoot(3, spp=spp, **how)
            c = film.compare(events, truth)
            emd[name, spp] = c.emd
            print(f"  {spp:3d} {name:14} EMD {c.emd:8.3f}  recall {c.recall:.3f}"
                  f"  precision {c.precision:.3f}  events {len(events)}")  # fmt: skip
    for spp in (4, 16):
        assert emd["fixed, owen", spp] < emd["fresh, owen", spp]
