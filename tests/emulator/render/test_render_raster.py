"""The raster renderer: what it says where something is missing, and (slow) its light.

The slow tests need OpenGL; where it is missing they fail with the line that says what to install.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.emulator import World
from evs.emulator.base.features import Switches
from evs.emulator.base.scene import CameraModel, ObjectKind, SceneModel, SceneSnapshot
from evs.emulator.config import CameraConfig, PlanConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.render.raster import RasterRenderer, context
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene, load_model
from evs.msgs import EvsError
from reference.closed_forms import linear

DARK = '<visual><headlight active="0"/></visual>'
MATT = '<material name="matt" specular="0" rgba="{0} {0} {0} 1"/>'
BALL = '<geom type="sphere" size=".3"/>'
SUN = '<light type="directional" dir="0 0 -1" diffuse="1 1 1" castshadow="false"/>'
ABOVE = '<camera pos="0 0 5" projection="orthographic" fovy="2"/>'


# without OpenGL: complaints


def test_an_unknown_renderer_lists_those_there_are() -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BALL}</worldbody></mujoco>")
    bound = bind_camera(model, "", 8, 8)
    with pytest.raises(EvsError, match=r"renderer 'rester'.*raster") as caught:
        make_renderer(extract_scene(model), bound.model, RenderConfig(renderer="rester"), 1)
    assert "direct" in str(caught.value)


def test_without_the_extra_one_line_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", None)
    context.load_library.cache_clear()
    before = os.environ.get("PYOPENGL_PLATFORM")
    with pytest.raises(EvsError, match=r'pyrender.*: pip install "evs\[raster\]"$') as caught:
        context.load_library()
    assert "\n" not in str(caught.value)
    assert os.environ.get("PYOPENGL_PLATFORM") == before


ABSENT = """
import ctypes, sys
from evs.msgs import EvsError
whole = ctypes.CDLL.__init__
def without(self, name, *rest, **more):
    if name and any(part in str(name) for part in sys.argv[1].split(",")):
        raise OSError(f"{name}: cannot open shared object file")
    whole(self, name, *rest, **more)
ctypes.CDLL.__init__ = without
from evs.emulator.render.raster import context
try:
    context.Context(context.load_library())
except EvsError as error:
    print(error)
"""


def said(libraries: str, **variables: str) -> str:
    """What a fresh interpreter says that cannot load these libraries."""
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", ABSENT, libraries],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout


@pytest.mark.integration
@pytest.mark.parametrize("libraries", ["EGL", "libGL.,libGLES"])
def test_without_opengl_one_line_says_how_to_install_it(libraries: str) -> None:
    line = said(libraries)
    assert line.count("\n") == 1
    assert "apt install libegl1 libgl1 libgl1-mesa-dri" in line
    assert "do not load" in line


def test_importing_it_loads_no_opengl() -> None:
    program = (
        "import sys, evs.emulator.render.raster\n"
        "assert not {'pyrender', 'OpenGL', 'trimesh'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


# with OpenGL


def staged(
    model: mujoco.MjModel,
    view: CameraConfig | None = None,
    size: tuple[int, int] = (32, 32),
    ticks: int = 0,
) -> tuple[SceneModel, CameraModel, SceneSnapshot]:
    data = mujoco.MjData(model)
    for _ in range(ticks):
        mujoco.mj_step(model, data)
    bound = bind_camera(model, "", *size, view)
    return extract_scene(model), bound.model, SnapshotTaker(model, [bound]).snapshot(data, 0)


def light_of(xml: str, size: int = 32, **render: object) -> np.ndarray:
    """(size, size) luminance of an MJCF, seen by its first camera."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{DARK}{xml}</mujoco>")
    scene, camera, snapshot = staged(model, size=(size, size))
    config = RenderConfig(**{"renderer": "raster", "spp": 1, **render})  # type: ignore[arg-type]
    renderer = make_renderer(scene, camera, config, 1)
    assert renderer.traced_fraction == 1
    return renderer.render(snapshot, snapshot.cameras[0]).astype(np.float64)


def floor(lights: str, albedo: float = 0.5, more: str = "", size: int = 32) -> np.ndarray:
    """A matt floor from above, 2 m wide, orthographic; x right, y up."""
    return light_of(
        f"""<asset>{MATT.format(albedo)}</asset><worldbody>{ABOVE}{lights}
        <geom type="plane" size="9 9 .1" material="matt"/>{more}</worldbody>""",
        size,
    )


def pixel_centres(size: int = 32) -> tuple[np.ndarray, np.ndarray]:
    at = (np.arange(size) + 0.5) / size * 2 - 1
    return np.meshgrid(at, -at)


@pytest.mark.slow
def test_without_a_driver_one_line_says_how_to_install_it(tmp_path: Path) -> None:
    # the loader is there, and finds no vendor
    line = said("nothing", __EGL_VENDOR_LIBRARY_DIRS=str(tmp_path))
    assert line.count("\n") == 1
    assert "apt install libegl1 libgl1 libgl1-mesa-dri" in line


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gymnasium/ant", "dm_control/humanoid", "dm_control/dog"])
def test_silhouettes_and_light_agree_with_direct(name: str, robot_files: dict[str, Path]) -> None:
    scene, camera, snapshot = staged(load_model(robot_files[name]), size=(346, 260), ticks=20)
    # what raster leaves out is left out on both sides
    surfaces = tuple(replace(surface, reflectance=0.0) for surface in scene.surfaces)
    scene = replace(scene, surfaces=surfaces)
    config = RenderConfig(spp=1, shadows=False)
    # OpenGL reads an image once
    once = Switches.of(PlanConfig(off=("texture_filter",)))
    direct = NativeRenderer(scene, camera, config, 1, switches=once)
    raster = RasterRenderer(scene, camera, config)
    pose = snapshot.cameras[0]

    geom, distance = raster.hits(snapshot, pose)
    expected, expected_distance = direct.hits(snapshot, pose)
    same = geom == expected
    assert same.mean() >= 0.985
    hit = same & (geom >= 0)
    # a polygon of 48 sides lies 0.2 % of its radius inside of the circle
    away = np.abs(distance - expected_distance)[hit]
    assert np.quantile(away / expected_distance[hit], 0.99) < 2e-3
    assert (distance[geom < 0] == 0).all()

    light, traced = raster.render(snapshot, pose), direct.render(snapshot, pose)
    assert light.dtype == np.float32
    assert light.shape == (260, 346)
    # textures are filtered a little differently, which the mean does not see
    np.testing.assert_allclose(light.mean(), traced.mean(), rtol=5e-3)
    assert np.abs(light - traced)[same].mean() < 0.01 * traced.mean()


@pytest.mark.slow
def test_a_lambert_floor_under_a_directional_light_is_the_closed_form() -> None:
    light = floor('<light type="directional" dir="0 .6 -.8" diffuse=".7 .7 .7"/>')
    np.testing.assert_allclose(light, linear(0.5) * 0.7 * 0.8, rtol=1e-5)


@pytest.mark.slow
def test_light_is_linear_and_neither_clipped_nor_in_steps() -> None:
    x, y = pixel_centres(128)
    lamp = (
        '<light type="spot" pos="0 0 2" dir="0 0 -1" cutoff="{}" exponent="{}" diffuse="9 9 9"'
        ' attenuation="1 .5 .25"/>'
    )
    r = np.sqrt(x**2 + y**2 + 4)
    expected = linear(0.5) * 9 * (2 / r) / (1 + 0.5 * r + 0.25 * r**2)
    # 8 bits would be off by up to 2e-3 of white, and end at 1
    np.testing.assert_allclose(floor(lamp.format(89, 0), size=128), expected, rtol=1e-4)
    np.testing.assert_allclose(
        floor(lamp.format(89, 0).replace("9 9 9", "90 90 90"), size=128), 10 * expected, rtol=1e-4
    )
    narrow = floor(lamp.format(20, 8), size=128)
    inside = 2 / r >= np.cos(np.deg2rad(20))
    np.testing.assert_allclose(narrow[inside], (expected * (2 / r) ** 8)[inside], rtol=1e-4)
    assert (narrow[~inside] == 0).all()


@pytest.mark.slow
def test_physical_intensity_is_inverse_square() -> None:
    light = floor('<light type="point" pos="0 0 2" diffuse="1 1 1" intensity="4000"/>')
    x, y = pixel_centres()
    # 4000 cd at 2 m are 1000 lux, which is one unit
    r = np.sqrt(x**2 + y**2 + 4)
    # and a lamp's range is 10 m where nothing is said
    expected = linear(0.5) * 4 / r**2 * (2 / r) * (1 - (r / 10) ** 4) ** 2
    np.testing.assert_allclose(light, expected, rtol=1e-4)


@pytest.mark.slow
def test_more_lights_than_eight_add_up_and_the_headlight_can_go() -> None:
    light = floor(SUN.replace("1 1 1", ".1 .1 .1") * 12)
    np.testing.assert_allclose(light, linear(0.5) * 1.2, rtol=1e-5)
    scene = f"""<asset>{MATT.format(0.5)}</asset><visual><headlight ambient="0 0 0"
        diffuse=".4 .4 .4"/></visual><worldbody>{ABOVE}
        <geom type="plane" size="9 9 .1" material="matt"/></worldbody>"""
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{scene}</mujoco>")
    world, camera, snapshot = staged(model)
    for headlight, expected in (("model", linear(0.5) * 0.4), ("off", 0.0)):
        config = RenderConfig(renderer="raster", spp=1, headlight=headlight)
        seen = make_renderer(world, camera, config, 1).render(snapshot, snapshot.cameras[0])
        np.testing.assert_allclose(seen, expected, rtol=1e-5)


@pytest.mark.slow
def test_the_order_of_brightness_is_kept() -> None:
    greys = [0.1, 0.3, 0.5, 0.7, 0.9]
    tiles = "".join(
        f'<geom type="box" size=".2 1 .1" pos="{0.4 * i - 0.8} 0 1" rgba="{g} {g} {g} 1"/>'
        for i, g in enumerate(greys)
    )
    seen = floor(SUN.replace("diffuse", 'specular="0 0 0" diffuse'), more=tiles, size=40)
    columns = seen.mean(axis=0).reshape(5, 8)
    np.testing.assert_allclose(columns.mean(axis=1), [linear(g) for g in greys], rtol=1e-4)


@pytest.mark.slow
def test_a_checker_floor_has_its_squares_where_mujoco_has_them_and_fades_to_their_mean() -> None:
    def seen(texrepeat: int, size: float, fovy: float) -> np.ndarray:
        return light_of(
            f"""<asset><texture name="t" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 1 1"
                width="250" height="250"/>
            <material name="m" texture="t" texrepeat="{texrepeat} {texrepeat}" texuniform="true"
                specular="0"/></asset>
            <worldbody><camera pos="0 0 5" projection="orthographic" fovy="{fovy}"/>{SUN}
            <geom type="plane" size="{size} {size} .1" material="m" rgba="1 1 1 1"/></worldbody>""",
            64,
        )

    light = seen(2, 3, 2)
    x, y = pixel_centres(64)
    u, v = (x + 3) / 6 * 6, (1 - (y + 3) / 6) * 6
    first = (np.floor(u * 2) + np.floor(v * 2)) % 2 == 0
    inner = (np.abs(u * 2 - np.round(u * 2)) > 0.1) & (np.abs(v * 2 - np.round(v * 2)) > 0.1)
    np.testing.assert_allclose(light[first & inner], 0, atol=1e-6)
    np.testing.assert_allclose(light[~first & inner], 1, rtol=1e-5)
    # a pixel covers many squares: linear light of one half, not the coded one
    np.testing.assert_allclose(seen(50, 50, 40), 0.5, atol=0.02)


@pytest.mark.slow
def test_a_transparent_pane_lets_its_share_through() -> None:
    pane = '<geom type="box" size="1 1 .1" pos="0 0 1" rgba="0 0 0 .25"/>'
    light = floor(SUN.replace("diffuse", 'specular="0 0 0" diffuse'), more=pane)
    np.testing.assert_allclose(light, 0.75 * linear(0.5), rtol=1e-4)


@pytest.mark.slow
def test_orthographic_scale_and_principal_point() -> None:
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{ABOVE}<geom type="box" size=".5 .25 .5"/></worldbody></mujoco>'
    )
    scene, camera, snapshot = staged(model, size=(40, 40))
    for optics, rows, columns in (
        (camera, slice(15, 25), slice(10, 30)),
        (replace(camera, cx=25.0, cy=18.0), slice(13, 23), slice(15, 35)),
        (replace(camera, fx=10.0), slice(15, 25), slice(15, 25)),
    ):
        renderer = RasterRenderer(scene, optics, RenderConfig(spp=1))
        geom, distance = renderer.hits(snapshot, snapshot.cameras[0])
        # 20 px a m: the lid is 20 x 10 px, 4.5 m below the camera
        expected = np.full((40, 40), -1)
        expected[rows, columns] = 0
        np.testing.assert_array_equal(geom, expected)
        np.testing.assert_allclose(distance[geom == 0], 4.5, rtol=1e-6)


@pytest.mark.slow
def test_a_pinhole_off_its_centre_agrees_with_direct() -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BALL}</worldbody></mujoco>")
    scene, camera, snapshot = staged(model, size=(64, 48))
    optics = replace(camera, cx=20.0, cy=30.0, fx=camera.fx * 1.5)
    raster, direct = (
        make_renderer(scene, optics, RenderConfig(renderer=name, spp=1), 1)
        for name in ("raster", "direct")
    )
    assert isinstance(raster, RasterRenderer)
    assert isinstance(direct, NativeRenderer)
    geom, expected = (r.hits(snapshot, snapshot.cameras[0])[0] for r in (raster, direct))
    assert 200 < (expected == 0).sum() < 2500
    # single pixels of the rim
    assert (geom != expected).mean() < 0.01


@pytest.mark.slow
def test_edges_are_antialiased_as_spp_says() -> None:
    # the box ends 1/4 of a pixel into its last columns
    edge = '<geom type="box" size=".515625 2 .1" pos="0 0 1" rgba="1 1 1 1"/>'
    scene = f"<worldbody>{ABOVE}{SUN.replace('diffuse', 'specular=`0 0 0` diffuse')}{edge}"
    one, four = (
        light_of(f"{scene.replace('`', chr(34))}</worldbody>", spp=spp)[16] for spp in (1, 4)
    )
    np.testing.assert_allclose(one[[6, 7, 8]], [0, 0, 1], atol=1e-5)
    np.testing.assert_allclose(four[[6, 7, 8]], [0, 0.25, 1], atol=1e-5)


@pytest.mark.slow
def test_two_renderers_at_once_do_not_disturb_each_other() -> None:
    def stage(grey: float) -> tuple[RasterRenderer, SceneSnapshot]:
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>{DARK}<asset>{MATT.format(grey)}</asset><worldbody>{ABOVE}{SUN}
            <geom type="plane" size="9 9 .1" material="matt"/></worldbody></mujoco>"""
        )
        scene, camera, snapshot = staged(model, size=(16, 16))
        return RasterRenderer(scene, camera, RenderConfig(spp=4)), snapshot

    (dim, first), (bright, second) = stage(0.3), stage(0.8)
    for _ in range(2):
        for renderer, snapshot, grey in ((dim, first, 0.3), (bright, second, 0.8)):
            light = renderer.render(snapshot, snapshot.cameras[0])
            np.testing.assert_allclose(light, linear(grey), rtol=1e-5)
    # the one that goes does not take the other's display with it
    dim.close()
    dim.close()
    with pytest.raises(EvsError, match="closed"):
        dim.render(first, first.cameras[0])
    np.testing.assert_allclose(bright.render(second, second.cameras[0]), linear(0.8), rtol=1e-5)
    # nor, when it is collected later, that of one whose context lies where its own lay
    new, third = stage(0.5)
    del dim
    gc.collect()
    np.testing.assert_allclose(new.render(third, third.cameras[0]), linear(0.5), rtol=1e-5)
    np.testing.assert_allclose(bright.render(second, second.cameras[0]), linear(0.8), rtol=1e-5)
    closing = bright._close
    del bright, renderer
    gc.collect()
    assert not closing.alive


@pytest.mark.slow
def test_a_world_runs_on_it(robot_files: dict[str, Path]) -> None:
    def run() -> tuple[bytes, np.ndarray]:
        world = World(robot_files["gymnasium/humanoid"], control="random")
        camera = world.add_camera(render=RenderConfig(renderer="raster"))
        packets = [packet for _ in range(5) for packet in world.step()]
        assert [packet.time_end_us for packet in packets] == [1000, 2000, 3000, 4000, 5000]
        return b"".join(packet.events.tobytes() for packet in packets), camera.luminance

    events, picture = run()
    assert np.isfinite(picture).all()
    assert picture.std() > 0.01
    assert len(events) > 16 * 10
    # the same driver gives the same bytes
    assert run()[0] == events


@pytest.mark.slow
def test_tendons_ropes_and_sites_are_those_of_the_tracer() -> None:
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody>
      <geom name="roll" type="cylinder" size=".15 .05" euler="90 0 0"/>
      <site name="s" pos="-.4 0 -.2" type="box" size=".03 .04 .05"/>
      <body pos=".4 0 -.3"><freejoint/><geom size=".05"/><site name="e"/></body>
      <flexcomp name="rope" type="grid" count="4 1 1" spacing=".1 .1 .1" radius=".02" dim="1"
        pos="0 0 -.4" mass="1"><edge equality="true"/></flexcomp>
    </worldbody><tendon>
      <spatial width=".02"><site site="s"/><geom geom="roll"/><site site="e"/></spatial>
    </tendon></mujoco>""")
    view = CameraConfig(lookat=(0, 0, -0.1), distance=1.3, azimuth=80, elevation=-10)
    scene, camera, snapshot = staged(model, view, (64, 48), 20)
    pose = snapshot.cameras[0]
    for sites in (True, False):
        traced = NativeRenderer(scene, camera, RenderConfig(spp=1, sites=sites), 1)
        drawn = make_renderer(scene, camera, RenderConfig(renderer="raster", spp=1, sites=sites), 1)
        ours, theirs = drawn.hits(snapshot, pose)[0], traced.hits(snapshot, pose)[0]
        assert np.mean(ours == theirs) > 0.995
        things = set(scene.geom_kind[theirs[theirs >= 0]].tolist())
        assert things == {ObjectKind.GEOM, ObjectKind.TENDON, ObjectKind.ROPE} | (
            {ObjectKind.SITE} if sites else set()
        )


@pytest.mark.slow
def test_a_forked_process_is_told_so() -> None:
    program = (
        "import os, signal, mujoco\n"
        "from evs import EvsError, RenderConfig, EventCamera, SensorConfig\n"
        "model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=\".1\"/>'\n"
        "    '<camera pos=\"0 0 1\"/></worldbody></mujoco>')\n"
        "data = mujoco.MjData(model)\n"
        "camera = EventCamera(model, '', sensor=SensorConfig('ideal', width=16, height=12),\n"
        "                render=RenderConfig('raster'))\n"
        "camera.observe(data)\n"
        "data.time += 1e-3\n"
        "if os.fork() == 0:\n"
        "    signal.alarm(20)\n"
        "    try:\n"
        "        camera.observe(data)\n"
        "    except EvsError as error:\n"
        "        print(error, flush=True)\n"
        "    del camera\n"
        "    os._exit(0)\n"
        "assert os.wait()[1] == 0\n"
        "camera.observe(data)\n"
        "print('and the parent goes on')"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, check=False
    )
    told, parent = done.stdout.splitlines()
    assert "does not work in a forked process" in told
    assert parent == "and the parent goes on"
    assert done.stderr == ""
