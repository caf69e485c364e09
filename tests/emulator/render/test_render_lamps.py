"""Lamps as MuJoCo's physical renderer has them, image lights, fog and haze, in closed form."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import LightKind, SceneModel
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from evs.msgs import EvsError
from reference.closed_forms import linear

DARK = '<visual><headlight active="0"/></visual>'
PAPER = '<material name="paper" specular="0" rgba="1 1 1 1"/>'
SIZE = 32


def seen(
    model: mujoco.MjModel, scene: SceneModel | None = None, size: int = SIZE, **render: object
) -> np.ndarray:
    """Return what the model's first camera sees: linear colour, (size, size, 3) float64."""
    bound = bind_camera(model, "", size, size)
    frame = SnapshotTaker(model, [bound]).snapshot(mujoco.MjData(model), 0)
    # the images of image lights hold linear values here
    config = RenderConfig(**{"spp": 1, "linear_textures": ("sky",), **render})  # type: ignore[arg-type]
    renderer = NativeRenderer(scene or extract_scene(model), bound.model, config, 1, rgb=True)
    renderer.render(frame, frame.cameras[0])
    assert renderer.rgb is not None
    return renderer.rgb.astype(np.float64)


def load(xml: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")


@pytest.mark.parametrize("range_m", [2.2, 5.0, 0.0])
def test_a_lamp_with_an_intensity_ends_at_its_range(range_m: float) -> None:
    model = load(f"""{DARK}<asset>{PAPER}</asset><worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="4"/>
        <light type="point" pos="0 0 2" diffuse="1 1 1" intensity="4000" range="{range_m}"/>
        <geom type="plane" size="9 9 .1" material="paper"/></worldbody>""")
    x = (np.arange(SIZE) + 0.5) / SIZE * 4 - 2
    square = x[:, np.newaxis] ** 2 + x**2 + 4
    window = np.maximum(1 - (square / range_m**2) ** 2, 0) ** 2 if range_m else 1.0
    expected = 4 / square * window * 2 / np.sqrt(square)
    light = seen(model)[..., 0]
    np.testing.assert_allclose(light, expected, rtol=1e-4, atol=1e-6)
    assert (range_m == 2.2) == (light == 0).any()


@pytest.mark.parametrize("softness", [0.0, 0.5, 1.0])
def test_a_spot_with_an_intensity_fades_over_its_softness(softness: float) -> None:
    model = load(f"""{DARK}<asset>{PAPER}</asset><worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="4"/>
        <light type="spot" pos="0 0 2" diffuse="1 1 1" intensity="4000" range="1e6" cutoff="30"
          softness="{softness}" exponent="50"/>
        <geom type="plane" size="9 9 .1" material="paper"/></worldbody>""")
    x = (np.arange(SIZE) + 0.5) / SIZE * 4 - 2
    distance = np.sqrt(x[:, np.newaxis] ** 2 + x**2 + 4)
    cosine, outer = 2 / distance, np.cos(np.deg2rad(30))
    inner = np.cos(np.deg2rad(30 * (1 - softness)))
    cone = np.clip((cosine - outer) / max(inner - outer, 1 / 1024), 0, 1) ** 2
    expected = 4 / distance**2 * cosine * cone
    np.testing.assert_allclose(seen(model)[..., 0], expected, rtol=2e-3, atol=2e-5)


def test_a_spot_without_an_intensity_keeps_its_exponent() -> None:
    xml = """{0}<asset>{1}</asset><worldbody><camera pos="0 0 5"/>
        <light type="spot" pos="0 0 2" softness="{2}" range="{3}"/>
        <geom type="plane" size="9 9 .1" material="paper"/></worldbody>"""
    one, two = (seen(load(xml.format(DARK, PAPER, *more))) for more in ((0.1, 1), (0.9, 50)))
    np.testing.assert_array_equal(one, two)


def sky_of(faces: np.ndarray, light: str = "", material: str = PAPER) -> mujoco.MjModel:
    """Return the model of a large ball in the light of an image.

    Args:
        faces: The cube map, (6, w, w, 3) uint8.
        light: The intensity of the image light, cd/m^2; "" leaves the default.
        material: MJCF of the ball's material, `paper`.
    """
    spec = mujoco.MjSpec.from_string(f"""<mujoco>{DARK}<asset>{material}</asset><worldbody>
        <camera pos="0 -4 0" xyaxes="1 0 0 0 0 1" projection="orthographic" fovy="2"/>
        <geom size="1" material="paper"/></worldbody></mujoco>""")
    width = faces.shape[1]
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_CUBE, width=width, height=6 * width,
        nchannel=3, data=list(faces.tobytes()), colorspace=mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR,
    )  # fmt: skip
    added = spec.worldbody.add_light(
        name="image", type=mujoco.mjtLightType.mjLIGHT_IMAGE, texture="sky", diffuse=[1, 1, 1]
    )
    if light:
        added.intensity = float(light)
    return spec.compile()


def ball_normals() -> tuple[np.ndarray, np.ndarray]:
    """Return the normals (n, 3) of the pixels that show the ball, and their mask (SIZE, SIZE)."""
    x, z = np.meshgrid(
        (np.arange(SIZE) + 0.5) / SIZE * 2 - 1, 1 - (np.arange(SIZE) + 0.5) / SIZE * 2
    )
    on = x**2 + z**2 < 0.95
    return np.stack([x, -np.sqrt(np.maximum(1 - x**2 - z**2, 0)), z], -1)[on], on


def faces_of(radiance: object, width: int = 32) -> np.ndarray:
    """Draw radiance(directions (n, 3)) -> (n,) as OpenGL's cube map, y up: (6, w, w, 3) uint8."""
    at = (np.arange(width) + 0.5) / width * 2 - 1
    s, t = np.meshgrid(at, at)
    one = np.ones_like(s)
    cube = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    # the world's z is the cube's y
    world = np.stack([np.stack([x, -z, y], -1) for x, y, z in cube])
    world /= np.linalg.norm(world, axis=-1, keepdims=True)
    grey = radiance(world.reshape(-1, 3)).reshape(6, width, width)  # type: ignore[operator]
    return np.repeat(np.round(grey * 255).astype(np.uint8)[..., np.newaxis], 3, -1)


def test_an_even_image_is_a_furnace() -> None:
    faces = np.full((6, 8, 8, 3), (255, 51, 102), np.uint8)
    _, on = ball_normals()
    np.testing.assert_allclose(seen(sky_of(faces))[on], [[1, 0.2, 0.4]] * on.sum(), rtol=1e-5)
    # white texels of 1000 / pi cd/m^2 give 1000 lux on every surface
    bright = seen(sky_of(faces, light=str(1000 / np.pi)))
    np.testing.assert_allclose(bright[on], [[1, 0.2, 0.4]] * on.sum(), rtol=1e-5)


def test_an_image_lights_from_where_its_faces_are() -> None:
    faces = faces_of(lambda d: 0.5 + d @ [0.2, 0.1, -0.15])
    normals, on = ball_normals()
    # two thirds of a gradient in radiance arrive at the surface
    expected = 0.5 + 2 / 3 * normals @ np.array([0.2, 0.1, -0.15])
    np.testing.assert_allclose(seen(sky_of(faces))[on][:, 0], expected, atol=2e-3)


def test_half_a_sky_lights_by_the_view_factor() -> None:
    faces = faces_of(lambda d: (d[:, 2] > 0).astype(float))
    normals, on = ball_normals()
    # a surface sees (1 + cos) / 2 of the upper half, which order 2 represents exactly
    np.testing.assert_allclose(seen(sky_of(faces))[on][:, 0], (1 + normals[:, 2]) / 2, atol=5e-3)


def test_a_hard_sky_is_lit_as_well_as_order_two_can() -> None:
    # only the upper face shines: integrate the cosine over distance^3 over its texels
    faces = np.zeros((6, 16, 16, 3), np.uint8)
    faces[2] = 255
    normals, on = ball_normals()
    at = (np.arange(64) + 0.5) / 32 - 1
    x, y = (axis.ravel() for axis in np.meshgrid(at, at))
    towards = np.stack([x, y, np.ones_like(x)], -1)
    cosines = np.maximum(normals @ towards.T, 0)
    expected = cosines @ ((towards**2).sum(-1) ** -2.0) / np.pi / 32**2
    assert expected.max() > 0.5
    light = seen(sky_of(faces))[on][:, 0]
    # Ramamoorthi and Hanrahan 2001: at most 9 % of the brightest anywhere, and 3 % on average
    assert np.abs(light - expected).max() < 0.09 * expected.max()
    assert np.abs(light - expected).mean() < 0.03 * expected.max()
    assert (light >= 0).all()


def test_a_metal_shows_the_image_where_it_mirrors() -> None:
    faces = faces_of(lambda d: 0.5 + d @ [0.3, 0.2, 0.2])
    metal = '<material name="paper" metallic="1" roughness=".5" rgba="1 1 1 1"/>'
    normals, on = ball_normals()
    ray = np.array([0.0, 1, 0])
    mirrored = ray - 2 * normals * (normals @ ray)[:, np.newaxis]
    expected = 0.5 + 2 / 3 * mirrored @ np.array([0.3, 0.2, 0.2])
    np.testing.assert_allclose(seen(sky_of(faces, material=metal))[on][:, 0], expected, atol=4e-3)


def test_an_image_light_brings_its_image() -> None:
    scene = extract_scene(sky_of(np.full((6, 4, 4, 3), 9, np.uint8), light="40"))
    (light,) = scene.lights
    assert (light.kind, light.intensity, light.name) == (LightKind.IMAGE, 40.0, "image")
    assert scene.textures[light.texture].data.shape == (6, 4, 4, 3)


AIR = """<visual><headlight active="0"/><map fogstart="{start}" fogend="{end}" haze="{haze}"
    zfar="50"/><rgba fog=".2 .4 .6 1" haze=".9 .5 .3 1"/></visual><statistic extent="1"/>"""
GLOW = '<material name="glow" specular="0" emission="1" rgba="1 .5 .25 1"/>'


@pytest.mark.parametrize(("start", "end"), [(1, 3), (0, 10), (4, 5), (0.5, 1), (2, 2), (-2, 6)])
def test_fog_takes_the_place_of_light_by_its_distance(start: float, end: float) -> None:
    model = load(f"""{AIR.format(start=start, end=end, haze=0)}<asset>{GLOW}</asset><worldbody>
        <camera pos="0 0 2" fovy="90"/><geom type="plane" size="9 9 .1" material="glow"/>
        </worldbody>""")
    at = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    distance = 2 * np.sqrt(1 + at**2 + at[:, np.newaxis] ** 2)
    clear = np.clip((end - distance) / max(end - start, 1e-6), 0, 1)[..., np.newaxis]
    colour, fog = linear([1, 0.5, 0.25]), linear([0.2, 0.4, 0.6])
    np.testing.assert_allclose(seen(model, fog=True), fog + (colour - fog) * clear, rtol=1e-4)
    np.testing.assert_allclose(seen(model), np.broadcast_to(colour, (SIZE, SIZE, 3)), rtol=1e-5)


def test_fog_is_all_there_is_of_the_sky() -> None:
    sky = '<texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8" height="48"/>'
    model = load(f"""{AIR.format(start=1, end=3, haze=0)}<asset>{sky}</asset><worldbody>
        <camera pos="0 0 2"/><geom size=".1" pos="0 0 9"/></worldbody>""")
    fog = np.broadcast_to(linear([0.2, 0.4, 0.6]), (SIZE, SIZE, 3))
    np.testing.assert_allclose(seen(model, fog=True), fog, rtol=1e-5)
    assert (seen(model) > 0.99).all()


HORIZON = """{air}<asset>{glow}{sky}</asset><worldbody>
    <camera pos="0 0 {height}" xyaxes="1 0 0 0 0 1" fovy="20"/>
    <geom type="plane" size="{size} {size} .1" material="glow"/></worldbody>"""
SKY = (
    '<texture type="skybox" builtin="flat" rgb1=".2 .2 .2" rgb2=".2 .2 .2" width="8" height="48"/>'
)


def horizon(height: float = 3.0, size: float = 0, sky: str = SKY, haze: float = 0.4) -> str:
    air = AIR.format(start=1, end=2, haze=haze)
    return HORIZON.format(air=air, glow=GLOW, sky=sky, height=height, size=size)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_haze_lies_where_mujoco_draws_it(ratio: float) -> None:
    # MuJoCo's cone rises from the plane at (1 - ratio) 0.7 zfar to the eye's height at 0.7 zfar;
    # it is opaque in front of the foot of the sky, a wall of that radius where the plane ends
    size, height, rim = 96, 3.0, 0.7 * 50
    light = seen(load(horizon(height, haze=ratio)), size=size)
    slope = ((np.arange(size) + 0.5) / size * 2 - 1) * np.tan(np.deg2rad(10))  # down
    column = size // 2 + 0.5 - size / 2
    sideways = column / size * 2 * np.tan(np.deg2rad(10))
    slope = slope / np.sqrt(1 + sideways**2)
    inner = np.arctan2(1, ratio)
    peak = np.sqrt(0.5) * ratio * np.sin(inner) / np.sin(0.75 * np.pi - inner)
    # the ray's height at radius r is eye - slope r; on the cone r = rim (1 - ratio (1 - h))
    rows = np.linspace(0, 1, 20001)
    on_cone = height * (1 - rows) / (rim * (1 - ratio * (1 - rows)))
    h = np.interp(slope, on_cone[::-1], rows[::-1], left=1, right=0)
    cover = np.where(h < peak, h / peak, (1 - h) / (1 - peak))[:, np.newaxis]
    floor = slope[:, np.newaxis] > height / rim
    behind = np.where(floor, linear([1, 0.5, 0.25]), linear([51 / 255] * 3))
    expected = behind + (linear([0.9, 0.5, 0.3]) - behind) * cover
    np.testing.assert_allclose(light[:, size // 2], expected, rtol=2e-3, atol=2e-3)
    assert cover.max() > 0.8


def test_haze_needs_a_sky_a_plane_without_bounds_and_a_camera_above_it() -> None:
    def changes(xml: str) -> bool:
        model = load(xml)
        return bool((seen(model) != seen(model, haze=False)).any())

    assert changes(horizon())
    assert not changes(horizon(size=90))
    assert not changes(horizon(sky=""))
    assert not changes(horizon(height=-1))
    assert not changes(horizon(haze=0))
    assert not changes(horizon().replace('fovy="20"', 'projection="orthographic" fovy="2"'))


def test_what_stands_before_the_haze_hides_it() -> None:
    xml = horizon().replace("</worldbody>", '<geom type="box" size="5 .1 5" pos="0 {} 0"/>{}')
    near, far = (load(xml.format(y, "</worldbody>")) for y in (10, 40))
    assert (seen(near) == seen(near, haze=False)).all()
    assert (seen(far) != seen(far, haze=False)).any()


@pytest.mark.parametrize("isa", _core.isa_available())
def test_air_and_image_are_the_same_bytes_everywhere(isa: str) -> None:
    model = load(horizon())
    scene = extract_scene(model)
    image = extract_scene(sky_of(faces_of(lambda d: 0.5 + d @ [0.2, 0.1, -0.15])))
    lamp = replace(image.lights[0], texture=len(scene.textures))
    scene = replace(scene, lights=(lamp,), textures=(*scene.textures, *image.textures))
    bound = bind_camera(model, "", 45, 31, CameraConfig(lookat=(0, 5, 1), distance=6))
    shot = SnapshotTaker(model, [bound]).snapshot(mujoco.MjData(model), 0)
    shot = replace(shot, light_pos=np.zeros((1, 3)), light_dir=np.array([[0, 0, -1.0]]))
    taken = {
        NativeRenderer(scene, bound.model, RenderConfig(spp=2, fog=True, isa=i), threads)
        .render(shot, shot.cameras[0])
        .tobytes()
        for i, threads in (("portable", 1), (isa, 1), (isa, 3))
    }
    assert len(taken) == 1


def test_colours_are_cut_to_what_mujoco_means_and_nan_is_refused() -> None:
    model = load("""<asset><material name="m" specular="1" rgba="1 1 1 1"/></asset><worldbody>
        <camera pos="0 0 3"/><light name="lamp" diffuse="1 1 1" type="directional"/>
        <geom type="plane" size="9 9 .1" material="m"/></worldbody>""")
    usual = seen(model)
    model.mat_rgba[0] = 1e30
    model.mat_specular[0] = 1e30
    np.testing.assert_array_equal(seen(model), usual)
    model.light_diffuse[0] = -3
    model.light_specular[0] = -1e30
    dark = seen(model)
    assert (dark >= 0).all()
    assert (dark <= usual).all()
    model.light_diffuse[0] = 1e30
    assert np.isfinite(seen(model)).all()
    model.light_diffuse[0, 1] = np.nan
    with pytest.raises(EvsError, match=r"^diffuse of light 'lamp' is nan; give a number in 0 "):
        extract_scene(model)
    model.light_diffuse[0, 1] = 1
    model.mat_emission[0] = np.inf
    with pytest.raises(EvsError, match=r"^emission of material 'm' is inf"):
        extract_scene(model)
