"""Contrast-adaptive antialiasing: all samples at edges, one elsewhere, and no jump in between.

Outlines of shapes are no such edges (test_render_outlines.py), so tests of edges leave them out.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from evs.emulator import World, _core
from evs.emulator.base.scene import F32, CameraPose
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SensorConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.sensor import resolve_sensor
from evs.msgs import Events, EvsError, join_events
from reference.instants import Film
from reference.scenes import SAMPLED_OUTLINES

WIDTH, HEIGHT = 67, 45  # no multiple of a packet

ROOM = """
<mujoco>
  <option timestep=".001"/>
  <visual><headlight diffuse=".3 .3 .3" ambient=".1 .1 .1"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="32"
            height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="64"
            height="64"/>
    <material name="floor" texture="tiles" texrepeat="4 4" texuniform="true" reflectance=".3"/>
  </asset>
  <worldbody>
    <light type="directional" dir=".3 .2 -1" diffuse="{tint}"/>
    <light type="spot" pos="1 -1 2" dir="-1 1 -2" cutoff="30" exponent="4" diffuse=".6 .6 .6"/>
    <geom type="plane" size="3 3 .1" material="floor"/>
    <geom type="box" size=".2 .2 .2" pos="-.6 .5 .2" rgba=".9 .8 .3 1"/>
    <geom type="sphere" size=".2" pos=".6 .6 .2" rgba=".9 .3 .3 .5"/>
    <body pos="0 0 .8"><freejoint/>
      <geom type="capsule" size=".1 .25" euler="30 40 0"/>
      <geom type="cylinder" size=".08 .1" pos="0 -.2 .1"/>
    </body>
  </worldbody>
</mujoco>
"""

# nothing but light of its own and black: every step of luminance is an edge
EDGES = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset><material name="lamp" emission="1" specular="0"/></asset>
  <worldbody>
    <geom type="box" size=".3 .5 .01" pos="0 0 0" euler="0 0 {angle}" material="lamp"/>
    <geom type="sphere" size=".2" pos=".8 .2 0" material="lamp"/>
  </worldbody>
</mujoco>
"""


DOWN = CameraConfig(lookat=(0, 0, 0), distance=2.5, azimuth=90, elevation=-90)


def room(ticks: int, tint: str = ".5 .5 .5"):
    """(scene, camera, snapshots one a ms) of a body that falls, tumbling."""
    view = CameraConfig(lookat=(0, 0, 0.3), distance=2.6, azimuth=70, elevation=-25)
    film = Film(ROOM.format(tint=tint), (WIDTH, HEIGHT), view)
    film.data.qvel[3:] = (3, 5, 2)
    return film.scene, film.camera, film.snapshots(ticks)


def adaptive(scene, camera, threads: int = 1, rgb: bool = False, **render: object):
    """A renderer whose pixels at edges take 5 samples, if nothing else is said."""
    settings = {"spp": 5, "antialiasing": "adaptive", **render}
    return NativeRenderer(scene, camera, RenderConfig(**settings), threads, rgb)  # type: ignore[arg-type]


def pan(poses: int, step_px: float, angle: float, **render: object) -> F32:
    """(poses, h, w) light of EDGES from a camera that slides by step_px pixels a pose."""
    film = Film(EDGES.format(angle=angle), (WIDTH, HEIGHT), DOWN)
    rest = film.shot.cameras[0]
    renderer = film.renderer(switches=SAMPLED_OUTLINES, **{"antialiasing": "fixed", **render})
    right = rest.mat.reshape(3, 3)[:, 0] * 2.5 / film.camera.fx
    return np.stack([
        renderer.render(film.shot, CameraPose(rest.pos + right * (step_px * k), rest.mat)).copy()
        for k in range(poses)
    ])  # fmt: skip


@pytest.mark.parametrize("tint", [".5 .5 .5", ".5 .3 .2"], ids=["grey", "coloured"])
def test_every_instruction_set_and_thread_count_gives_the_same_bytes(tint: str) -> None:
    scene, camera, frames = room(21, tint)
    reference = adaptive(scene, camera, isa="portable", incremental=False)
    others = [
        adaptive(scene, camera, threads, isa=isa, incremental=False)
        for isa in _core.isa_available()
        for threads in (1, 3)
    ]
    for frame in frames[::10]:
        light = reference.render(frame, frame.cameras[0]).tobytes()
        assert all(o.render(frame, frame.cameras[0]).tobytes() == light for o in others)


@pytest.mark.parametrize("spp", [2, 5, 16, 33])
def test_incremental_equals_full_tracing(spp: int) -> None:
    scene, camera, frames = room(200 if spp == 5 else 40)
    kept = adaptive(scene, camera, spp=spp)
    full = adaptive(scene, camera, spp=spp, incremental=False)
    fractions = []
    for k, frame in enumerate(frames):
        rest = frame.cameras[0]
        # for a few ticks the camera moves too
        pose = CameraPose(rest.pos + np.array([0.003 * min(max(k - 20, 0), 5), 0, 0]), rest.mat)
        np.testing.assert_array_equal(kept.render(frame, pose), full.render(frame, pose))
        fractions.append(kept.traced_fraction)
    assert fractions[0] == 1
    assert min(fractions) < 0.6
    # and nothing is traced where nothing moves
    kept.render(frames[-1], pose)
    assert kept.traced_fraction == 0


@pytest.mark.parametrize("isa", _core.isa_available())
def test_single_pixels_have_the_frames_light(isa: str) -> None:
    scene, camera, frames = room(30)
    renderer, frame = adaptive(scene, camera, 2, isa=isa), frames[-1]
    whole = renderer.render(frame, frame.cameras[0]).copy()
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    pixels = np.random.default_rng(3).permutation(pixels)
    light = renderer.trace(frame, frame.cameras[0], pixels)
    np.testing.assert_array_equal(light, whole[pixels[:, 1], pixels[:, 0]])


@pytest.mark.parametrize("tint", [".5 .5 .5", ".5 .3 .2"], ids=["grey", "coloured"])
def test_colour_is_refined_with_the_luminance_and_leaves_its_bytes(tint: str) -> None:
    scene, camera, frames = room(30, tint)
    one, both = adaptive(scene, camera), adaptive(scene, camera, rgb=True)
    for frame in frames[::10]:
        light = both.render(frame, frame.cameras[0])
        np.testing.assert_array_equal(one.render(frame, frame.cameras[0]), light)
        assert both.rgb is not None
        grey = both.rgb.astype(np.float64) @ (0.2126, 0.7152, 0.0722)
        np.testing.assert_allclose(light, grey, rtol=1e-4, atol=1e-6)


def test_one_sample_where_nothing_differs_and_all_where_something_does() -> None:
    light = pan(1, 0, 20, spp=16, antialiasing="adaptive")[0]
    np.testing.assert_array_equal(light, pan(1, 0, 20, spp=16)[0])
    sixteenths = light * 16 / light.max()
    np.testing.assert_allclose(sixteenths, np.round(sixteenths), atol=1e-4)
    assert len(np.unique(np.round(sixteenths))) > 10
    # with one sample there is nothing to adapt
    one = pan(1, 0, 20, spp=1)
    np.testing.assert_array_equal(pan(1, 0, 20, spp=1, antialiasing="adaptive"), one)


@pytest.mark.parametrize("angle", [0, 20, 45, 90])
def test_an_edge_that_creeps_through_pixels_makes_no_jump(angle: float) -> None:
    # 1/64 px a pose: of 16 points, each in a column of its own, one edge passes one or two
    light = pan(140, 1 / 64, angle, spp=16, antialiasing="adaptive")
    full = pan(140, 1 / 64, angle, spp=16)
    np.testing.assert_array_equal(light, full)
    step = np.abs(np.diff(light, axis=0)).max()
    assert 0.9 / 16 < step / light.max() < 3.1 / 16


def test_light_that_bends_more_and_more_is_blended_in() -> None:
    # the light's contrast grows slowly: the share of the other samples has to grow slowly too
    xml = """
    <mujoco><visual><headlight diffuse="0 0 0" ambient=".5 .5 .5" specular="0 0 0"/></visual>
      <worldbody>
        <geom type="plane" size="5 5 .1" rgba=".5 .5 .5 1"/>
        <geom type="box" size=".4 .6 .01" pos="0 0 .1" euler="0 0 17" rgba="{c} {c} {c} 1"/>
      </worldbody></mujoco>"""
    frames = {"adaptive": [], "fixed": []}  # type: dict[str, list[F32]]
    shades = np.linspace(0.5, 0.56, 61)
    for shade in shades:
        film = Film(xml.format(c=shade), (WIDTH, HEIGHT), DOWN)
        for mode, taken in frames.items():
            taken.append(film.light(switches=SAMPLED_OUTLINES, spp=16, antialiasing=mode))
    light, full = np.stack(frames["adaptive"]), np.stack(frames["fixed"])
    # at first one sample stands for all, in the end all are there
    assert not np.array_equal(light[5], full[5])
    np.testing.assert_allclose(light[-1], full[-1], rtol=1e-6)
    # never more of a step than the shade's own (0.4 % of the light) and the share's rise with it
    assert np.abs(np.diff(light, axis=0) / light[:-1]).max() < 0.02


def moved(events: Events, truth: Events, ticks: int) -> float:
    """Earth mover's distance in events per pixel, written plainly."""
    surplus = np.zeros((2, HEIGHT, WIDTH, ticks + 1))
    for stream, sign in ((events, 1), (truth, -1)):
        inside = stream[(stream["t"] > 0) & (stream["t"] <= 1000 * ticks)]
        tick = -(-inside["t"] // 1000)
        np.add.at(surplus, (inside["p"], inside["y"], inside["x"], tick), sign)
    surplus = np.cumsum(surplus, axis=-1)
    forwards = np.abs(surplus[..., 1:]).sum()
    backwards = np.abs(surplus[..., -1:] - surplus[..., :-1]).sum()
    return float((forwards + backwards) / (2 * ticks * WIDTH * HEIGHT))


@pytest.mark.slow
def test_events_are_those_of_16_samples_everywhere() -> None:
    scene, camera, frames = room(120)
    # light alone makes the events: pixels with a spread of thresholds and a floor, without noise
    pixels = SensorConfig("ideal", width=WIDTH, height=HEIGHT, sigma_thres=0.03, dark_lux=0.1)
    sensor = resolve_sensor(pixels)

    def events(**render: object):
        config = RenderConfig(**{"antialiasing": "fixed", **render})  # type: ignore[arg-type]
        renderer = NativeRenderer(scene, camera, config, 1, switches=SAMPLED_OUTLINES)
        model = make_event_model(sensor, ModelConfig(), 1)
        state, parts = model.init(0), []
        for frame in frames:
            light = renderer.render(frame, frame.cameras[0])
            found, state = model.step(light, state, frame.t_us - 1000, frame.t_us)
            parts.append(found)
        return join_events(parts)

    truth = events(spp=256)
    emd = {
        name: moved(events(**render), truth, 119)
        for name, render in {
            "1": {"spp": 1},
            "4": {"spp": 4},
            "16": {"spp": 16},
            "adaptive": {"spp": 16, "antialiasing": "adaptive"},
        }.items()
    }
    assert len(truth) > 900
    assert emd["16"] < 0.6 * emd["4"] < 0.4 * emd["1"]
    assert emd["adaptive"] < 1.25 * emd["16"]


def test_another_name_is_refused() -> None:
    scene, camera, _ = room(1)
    with pytest.raises(EvsError, match="antialiasing 'adaptiv'; there is: adaptive, fixed"):
        make_renderer(scene, camera, RenderConfig(antialiasing="adaptiv"), 1)


def test_textures_of_planes_and_the_sky_are_read_at_several_points_of_a_pixel() -> None:
    # a checker (with specks, or it would be integrated as tiles) and stars that are no wider than
    # the pixels, without an edge of another kind
    xml = """
    <mujoco><visual><headlight diffuse="0 0 0" ambient="1 1 1" specular="0 0 0"/></visual>
      <asset>
        <texture type="skybox" builtin="flat" mark="random" random=".05" markrgb="1 1 1"
                rgb1=".2 .2 .2" rgb2=".2 .2 .2" width="256" height="1536"/>
        <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .1 .1" rgb2=".9 .9 .9"
                width="64" height="64" mark="random" random=".01" markrgb=".1 .1 .1"/>
        <material name="tiles" texture="tiles" texrepeat="5 5" texuniform="true"/>
      </asset>
      <worldbody><geom type="plane" size="0 0 .1" material="tiles"/></worldbody></mujoco>"""
    view = CameraConfig(lookat=(0, 0, 0.5), distance=4, azimuth=65, elevation=-15)
    film = Film(xml, (WIDTH, HEIGHT), view)
    # more samples than users may have
    many = RenderConfig(spp=256, antialiasing="fixed")
    truth = NativeRenderer(film.scene, film.camera, many, 1).render(film.shot, film.shot.cameras[0])
    one, four = (film.light(spp=spp, antialiasing="fixed") for spp in (1, 4))
    some = film.light(spp=4, antialiasing="adaptive")
    halves = {"sky": slice(0, HEIGHT // 4), "floor": slice(HEIGHT // 2, HEIGHT)}
    for rows in halves.values():
        error = [float(np.abs(a - truth)[rows].mean()) for a in (one, four, some)]
        # better than four whole samples, which are better than one
        assert error[2] < 0.9 * error[1] < 0.8 * error[0]


@pytest.mark.parametrize("texels", [24, 100, 400])
def test_a_smooth_sky_is_its_mean_in_every_pixel_within_a_bound(texels: int) -> None:
    xml = f"""
    <mujoco><asset><texture type="skybox" builtin="gradient" rgb1=".9 .7 .5" rgb2="0 .02 .1"
      width="{texels}" height="{6 * texels}"/></asset>
      <worldbody><geom size=".1" pos="0 0 -9"/></worldbody></mujoco>"""
    view = CameraConfig(lookat=(0, 0, 0), distance=4, azimuth=40, elevation=10, fovy=100)
    film = Film(xml, (WIDTH, HEIGHT), view)
    many = RenderConfig(spp=256, antialiasing="fixed")
    truth = NativeRenderer(film.scene, film.camera, many, 1).render(film.shot, film.shot.cameras[0])
    light = film.light(spp=4, antialiasing="adaptive")
    # SMOOTH of core/render/shading/environment.inl, and what 256 samples and eight taps leave
    assert np.all(np.abs(light - truth) < 0.008 * (truth + 1 / 255))


def test_the_sky_in_a_mirror_is_read_across_what_a_pixel_sees_of_it() -> None:
    xml = """
    <mujoco><visual><headlight active="0"/></visual>
      <asset>
        <texture type="skybox" builtin="flat" mark="random" random=".05" markrgb="1 1 1"
                rgb1=".2 .2 .2" rgb2=".2 .2 .2" width="256" height="1536"/>
        <material name="mirror" reflectance="1" specular="0"/>
      </asset>
      <worldbody><geom type="plane" size="0 0 .1" material="mirror"/></worldbody></mujoco>"""
    # the nearer to straight down, the less do the camera's axes lie across the mirrored rays
    for elevation in (-35, -50, -80):
        view = CameraConfig(lookat=(0, 0, 0), distance=4, azimuth=65, elevation=elevation)
        film = Film(xml, (WIDTH, HEIGHT), view)
        many = RenderConfig(renderer="hybrid", sky="light", spp=256, antialiasing="fixed")
        truth = NativeRenderer(film.scene, film.camera, many, 1).render(
            film.shot, film.shot.cameras[0]
        )
        error = [
            float(
                np.abs(
                    film.light(renderer="hybrid", sky="light", spp=4, antialiasing=kind) - truth
                ).mean()
            )
            for kind in ("fixed", "adaptive")
        ]
        assert error[1] < 0.8 * error[0]


WEDGE = """<mujoco><asset><mesh name="wedge" vertex="-1 -1 0  1 -1 0  0 1 0  0 0 1"/></asset>
<worldbody><geom {} euler="20 30 40" rgba=".8 .3 .2 1"/><camera name="eye" pos="0 0 4"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("shape", "render", "samples"),
    [
        ('type="mesh" mesh="wedge"', RenderConfig(renderer="hybrid"), 16),
        ('type="mesh" mesh="wedge"', RenderConfig(renderer="hybrid", spp=4), 4),
        ('type="mesh" mesh="wedge"', RenderConfig(renderer="hybrid", antialiasing="fixed"), 4),
        ('type="mesh" mesh="wedge"', RenderConfig(), 4),
        ('type="box" size="1 1 .2"', RenderConfig(renderer="hybrid"), 4),
    ],
)
def test_hybrid_takes_more_samples_at_edges_of_meshes(
    shape: str, render: RenderConfig, samples: int
) -> None:
    model = mujoco.MjModel.from_xml_string(WEDGE.format(shape))
    lights, sensor = {}, SensorConfig("ideal", width=32, height=24)
    for spp in (render.spp, 4, 16):
        world = World(model)
        camera = world.add_camera("eye", sensor=sensor, render=replace(render, spp=spp))
        world.step()
        lights[spp] = camera.luminance.tobytes()
        assert camera.plan.view["samples"] == (spp or samples)
    assert lights[render.spp] == lights[samples]
    assert lights[4] != lights[16]


def test_rays_find_what_of_a_pixel_faces_of_meshes_cover() -> None:
    # against many samples: where pixels show several faces, more than their samples decide
    model = mujoco.MjModel.from_xml_string(WEDGE.format('type="mesh" mesh="wedge"'))
    film = Film(model, (WIDTH, HEIGHT), camera="eye")
    many = RenderConfig(renderer="hybrid", spp=1024, antialiasing="fixed")
    truth = NativeRenderer(film.scene, film.camera, many, 1).render(film.shot, film.shot.cameras[0])
    light = {
        kind: film.light(renderer="hybrid", spp=16, antialiasing=kind)
        for kind in ("fixed", "adaptive")
    }
    edges = light["fixed"] != light["adaptive"]
    error = {kind: float(np.abs(found - truth)[edges].mean()) for kind, found in light.items()}
    assert edges.sum() > 50
    assert error["adaptive"] < 0.5 * error["fixed"]
