"""The `path` renderer as its users meet it: seeds, stillness, single pixels, colour, bad values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.msgs import EvsError
from reference.instants import Film

ROOM = """<mujoco><visual><headlight ambient=".1 .1 .1" diffuse="0 0 0"/></visual><asset>
    <material name="wall" rgba=".8 .7 .6 1" specular=".2"/>
    <material name="lamp" rgba="1 1 .9 1" emission="4"/>
    <material name="mirror" rgba=".5 .5 .5 1" reflectance=".6"/></asset><worldbody>
    <camera name="eye" pos="0 -3 1" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <light name="bulb" type="point" pos="1 -1 2" attenuation="0 0 1" bulbradius=".2"/>
    <geom type="plane" size="3 3 .1" material="wall"/>
    <geom name="lamp" type="sphere" pos="-.8 0 1.6" size=".2" material="lamp"/>
    <geom type="box" pos=".6 .5 .5" size=".3 .3 .5" euler="0 0 30" material="mirror"/>
    <body pos="-.2 0 .4"><freejoint/><geom type="capsule" size=".15 .3" material="wall"/></body>
    </worldbody></mujoco>"""


class Room(Film):
    """A glowing ball, a bulb, a mirror and a capsule that can move."""

    def __init__(self, view: CameraConfig | None = None) -> None:
        super().__init__(ROOM, (37, 29), view)

    def renderer(self, threads: int = 2, **how: Any) -> NativeRenderer:
        return super().renderer(threads, rgb=True, **{"renderer": "path", "spp": None, **how})

    def see(self, renderer: NativeRenderer, t_us: int = 0) -> F32:
        shot = self.taker.snapshot(self.data, t_us)
        return renderer.render(shot, shot.cameras[0]).copy()


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


def test_fixed_seeds_stay_and_fresh_ones_do_not(room: Room) -> None:
    fixed, fresh = room.renderer(), room.renderer(seeds="fresh")
    np.testing.assert_array_equal(room.see(fixed, 0), room.see(fixed, 1000))
    assert fixed.traced_fraction == 0.0
    first, second = room.see(fresh, 0), room.see(fresh, 1000)
    assert fresh.traced_fraction == 1.0
    assert np.mean((first != second)[first > 0]) > 0.95
    # the noise of a tick follows from its time: the same time, the same bytes
    np.testing.assert_array_equal(first, room.see(room.renderer(seeds="fresh"), 0))


def test_the_noise_follows_from_the_seed(room: Room) -> None:
    one, two = room.see(room.renderer(seed=1)), room.see(room.renderer(seed=2))
    assert np.mean((one != two)[one > 0]) > 0.95
    np.testing.assert_array_equal(one, room.see(room.renderer(seed=1)))
    assert np.isfinite(room.see(room.renderer(seed=-3))).all()


@pytest.mark.parametrize("sampler", ["owen", "sobol", "global", "random", "anchored"])
def test_every_sampler_finds_the_same_light(room: Room, sampler: str) -> None:
    means = [room.see(room.renderer(spp=32, sampler=sampler, seed=k)).mean() for k in range(12)]
    expected = room.see(room.renderer(spp=2048, seed=99)).mean()
    # Student's t with 11 degrees of freedom passes 5.5 once in 5000
    assert abs(np.mean(means) - expected) < 5.5 * np.std(means, ddof=1) / np.sqrt(12)
    assert np.std(means, ddof=1) < 0.02 * expected


def test_bounces_only_add_light(room: Room) -> None:
    means = [room.see(room.renderer(spp=64, bounces=n)).mean() for n in (0, 1, 4)]
    assert means[0] < means[1] < means[2]


def test_what_moves_is_traced_again() -> None:
    room = Room()
    kept, full = room.renderer(), room.renderer(incremental=False)
    for tick in range(4):
        room.data.qpos[0] += 0.01 * (tick % 2)
        kept_light, full_light = room.see(kept, tick), room.see(full, tick)
        np.testing.assert_array_equal(kept_light, full_light)
        # whole, and when it first moves; then what nothing moving touches is kept
        share = kept.traced_fraction
        assert share == (1.0, 1.0, 0.0, share)[tick]
    assert 0.0 < share < 0.3


@pytest.mark.parametrize(
    "view",
    [
        None,
        CameraConfig(
            distortion_model="plumb_bob",
            distortion=(-0.2, 0.05, 0.0, 0.0, 0.0),
            vignetting="cos4",
        ),
    ],
)
@pytest.mark.parametrize("render", [{"spp": 3}, {"spp": 8, "antialiasing": "adaptive"}])
def test_single_pixels_have_the_light_of_the_frame(
    view: CameraConfig | None, render: dict[str, Any]
) -> None:
    room = Room(view)
    renderer = room.renderer(seeds="fresh", **render)
    shot = room.taker.snapshot(room.data, 5000)
    frame = renderer.render(shot, shot.cameras[0]).copy()
    pixels = np.stack(np.meshgrid(np.arange(37), np.arange(29)), -1).reshape(-1, 2)[::-1]
    single = renderer.trace(shot, shot.cameras[0], pixels.astype(np.int32))
    np.testing.assert_array_equal(single, frame[pixels[:, 1], pixels[:, 0]])


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
def test_colour_is_the_luminance_in_parts(room: Room, antialiasing: str) -> None:
    renderer = room.renderer(spp=8, antialiasing=antialiasing)
    luminance = room.see(renderer)
    assert renderer.rgb is not None
    np.testing.assert_allclose(
        renderer.rgb @ np.array([0.2126, 0.7152, 0.0722]), luminance, rtol=1e-5, atol=1e-7
    )
    # a warm room: more red than blue
    assert renderer.rgb[..., 0].mean() > 1.1 * renderer.rgb[..., 2].mean()


@pytest.mark.slow
def test_a_mirror_looks_the_sky_up_as_wide_as_its_samples_are() -> None:
    """A floor that mirrors a fifth of a starry sky, as in dm_control: few of the samples see it."""
    xml = """<mujoco><visual><headlight active="0"/></visual>
        <asset><texture type="skybox" builtin="gradient" rgb1=".4 .6 .8" rgb2="0 0 0" width="400"
            height="2400" mark="random" markrgb="1 1 1"/>
        <material name="m" rgba=".2 .2 .2 1" reflectance=".2"/></asset><worldbody>
        <geom type="plane" size="9 9 .1" material="m"/></worldbody></mujoco>"""
    film = Film(xml, (40, 30), CameraConfig(lookat=(0, 0, 0), distance=3, elevation=-35))
    # a lookup of the pixel's share of one of all samples leaves 0.075, 0.077 and 0.062, and samples
    # that choose the mirror at random leave 0.050, 0.034 and 0.033
    for spp, measured in ((4, 0.050), (16, 0.029), (64, 0.024)):
        pictures = [film.light(renderer="path", spp=spp, seed=seed) for seed in range(24)]
        variance = np.log(np.stack(pictures) + 1e-3).var(0, ddof=1)
        assert np.sqrt(variance.mean()) < 1.08 * measured, spp


def test_hard_light_without_bounces_is_that_of_direct() -> None:
    """One white Lambert floor under a distant light: there both integrators are exact."""
    xml = """<mujoco><visual><headlight active="0"/></visual>
        <asset><material name="m" rgba=".5 .5 .5 1" specular="0"/></asset><worldbody>
        <camera pos="0 0 3"/><light type="directional" dir="0 .6 -.8" diffuse=".7 .7 .7"/>
        <geom type="plane" size="9 9 .1" material="m"/></worldbody></mujoco>"""
    path, direct = (Film(xml, (16, 16)).light(renderer=name) for name in ("path", "direct"))
    np.testing.assert_allclose(path, direct, rtol=1e-5)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"spp": 4097}, "render.spp is 4097; with renderer path it must be 1 ... 4096"),
        ({"spp": 65, "renderer": "direct"}, "render.spp is 65; with renderer direct it must be"),
        ({"bounces": -1}, "render.bounces is -1; it must be 0 ... 64"),
        ({"sampler": "halton"}, "halton"),
        ({"seeds": "new"}, "fresh"),
        ({"seeds": "fresh", "renderer": "direct"}, "no render.seeds 'fresh'; there is: fixed"),
    ],
)
def test_bad_values_are_refused_in_one_line(
    room: Room, wrong: dict[str, object], words: str
) -> None:
    config = RenderConfig(**{"renderer": "path", **wrong})  # type: ignore[arg-type]
    with pytest.raises(EvsError) as caught:
        make_renderer(room.scene, room.camera, config, 1)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
