"""Which samples serve an event camera where light is hard: `direct` with k fixed points a pixel,
everywhere or only at edges, against 256; and what points that are new in every tick do.

Robots of gymnasium and dm_control; a camera that stands still, pans at 170 px/s or slides at half
a metre a second. Light of `direct` has no noise, so all that differs is where in a pixel it is
sampled. lab/docs/sampling.md has the tables of
`.venv/bin/pytest -m bench -s lab/tests/bench/test_light_hard_study.py`.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.msgs import Events
from evs_lab.metrics.compare import Comparison
from reference.film import VIEWS
from reference.judged_film import JudgedFilm

WIDTH, HEIGHT, TICKS = 116, 87, 61
SCENES = ["gymnasium/humanoid", "dm_control/humanoid", "dm_control/cartpole"]
WAYS = {
    "fixed 1": RenderConfig(spp=1),
    "fixed 4": RenderConfig(antialiasing="fixed", spp=4),
    "fixed 8": RenderConfig(antialiasing="fixed", spp=8),
    "fixed 16": RenderConfig(antialiasing="fixed", spp=16),
    "adaptive 4": RenderConfig(antialiasing="adaptive", spp=4),
    "adaptive 16": RenderConfig(antialiasing="adaptive", spp=16),
}


def line(c: Comparison) -> str:
    return (
        f"EMD {c.emd:7.4f}  recall {c.recall:.3f}  precision {c.precision:.3f}"
        f"  static {c.spurious.static_rate_hz:6.3f} Hz  events {c.events}"
    )


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan", "slide"])
@pytest.mark.parametrize("name", SCENES)
def test_events_of_hard_light(name: str, motion: str, robot_files: dict[str, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot_files[name]))
    film = JudgedFilm(model, motion, WIDTH, HEIGHT, TICKS, VIEWS[name])

    def shoot(config: RenderConfig) -> tuple[Events, float]:
        return film.events_by(NativeRenderer(film.scene, film.camera, config, 1))

    truth, _ = shoot(RenderConfig(antialiasing="fixed", spp=256))
    own = film.compare(shoot(RenderConfig(antialiasing="fixed", spp=225))[0], truth)
    silence = film.compare(truth[:0], truth).emd
    print(f"\n{name}, {motion}: 256 samples, against 225\n  {line(own)}")
    print(f"  without any event EMD {silence:.4f}")
    found = {}
    for way, config in WAYS.items():
        events, ms = shoot(config)
        c = found[way] = film.compare(events, truth)
        print(f"  {way:12} {line(c)}  {ms:5.2f} ms", flush=True)
    if own.reference_events >= 500:
        emd = {way: c.emd for way, c in found.items()}
        # the reference can tell the ways apart
        assert own.emd < emd["fixed 16"] / 2
        assert emd["fixed 16"] < emd["fixed 8"] < emd["fixed 4"] < emd["fixed 1"]
        # samples at edges alone are nearly as good as everywhere, with four of them
        assert emd["adaptive 4"] < 1.1 * emd["fixed 4"]
        assert emd["adaptive 16"] < emd["adaptive 4"]
        # with sixteen where the camera stands: then edges alone make events
        if motion == "still":
            assert emd["adaptive 16"] < 1.3 * emd["fixed 16"]


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("motion", ["still", "pan", "slide"])
@pytest.mark.parametrize("name", SCENES)
def test_places_in_a_pixel_must_not_change(
    name: str, motion: str, robot_files: dict[str, Path]
) -> None:
    """`path` without bounces or anything large that shines draws only the place in the pixel."""
    spec = mujoco.MjSpec.from_file(str(robot_files[name]))
    for texture in [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]:
        spec.delete(texture)
    model = spec.compile()
    model.light_bulbradius[:] = 0
    model.light_ambient[:] = 0
    model.vis.headlight.ambient[:] = 0
    film = JudgedFilm(model, motion, WIDTH, HEIGHT, TICKS, VIEWS[name])

    def shoot(spp: int, seeds: str) -> Events:
        config = RenderConfig(renderer="path", bounces=0, spp=spp, seeds=seeds)
        return film.events_by(make_renderer(film.scene, film.camera, config, 2, seed=3))[0]

    truth = shoot(256, "fixed")
    print(f"\n{name}, {motion}, hard light by path: {len(truth)} events of 256 samples")
    for spp in (1, 4, 16):
        kept, drawn = (film.compare(shoot(spp, s), truth) for s in ("fixed", "fresh"))
        print(f"  {spp:2d} fixed {line(kept)}\n  {spp:2d} fresh {line(drawn)}", flush=True)
        if spp < 16:
            assert kept.emd < drawn.emd / 1.5
            assert kept.events < drawn.events
