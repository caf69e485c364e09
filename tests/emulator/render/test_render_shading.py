"""Light in closed form: small scenes whose luminance can be written down."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.config import CameraConfig
from evs.msgs import EvsError
from reference.closed_forms import linear
from reference.instants import Film
from reference.scenes import SAMPLED_OUTLINES

DARK = '<visual><headlight active="0"/></visual>'
MATT = '<material name="matt" specular="0" rgba="{0} {0} {0} 1"/>'


def light_of(
    xml: str,
    size: int = 32,
    view: CameraConfig | None = None,
    switches: Switches = UNFORCED,
    **render: object,
) -> np.ndarray:
    """(size, size) luminance of an MJCF, seen by its first camera."""
    film = Film(f"<mujoco>{xml}</mujoco>", (size, size), view)
    return film.light(switches=switches, **render).astype(np.float64)


def floor_from_above(
    lights: str, albedo: float = 0.5, more: str = "", **render: object
) -> np.ndarray:
    """An orthographic look straight down at a matt floor under `lights`; x right, y up, 2 m
    wide."""
    xml = f"""{DARK}<asset>{MATT.format(albedo)}</asset><worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="2"/>{lights}
        <geom type="plane" size="9 9 .1" material="matt"/>{more}</worldbody>"""
    return light_of(xml, **render)  # type: ignore[arg-type]


def pixel_centres(size: int = 32, width_m: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """World x and y, m, of each pixel's centre in `floor_from_above`."""
    at = (np.arange(size) + 0.5) / size * width_m - width_m / 2
    return np.meshgrid(at, -at)


def test_lambert_under_a_directional_light() -> None:
    light = floor_from_above('<light type="directional" dir="0 .6 -.8" diffuse=".7 .7 .7"/>')
    np.testing.assert_allclose(light, linear(0.5) * 0.7 * 0.8, rtol=1e-5)


def test_coloured_light_on_a_coloured_floor() -> None:
    light = light_of(f"""{DARK}<asset><material name="m" specular="0" rgba=".9 .5 .1 1"/></asset>
            <worldbody>
        <camera pos="0 0 5"/><light type="directional" dir="0 0 -1" diffuse=".2 .6 .4"/>
        <geom type="plane" size="9 9 .1" material="m"/></worldbody>""")
    expected = 0.2126 * linear(0.9) * 0.2 + 0.7152 * linear(0.5) * 0.6 + 0.0722 * linear(0.1) * 0.4
    np.testing.assert_allclose(light, expected, rtol=1e-5)


def test_point_light_falls_off_as_the_model_says() -> None:
    x, y = pixel_centres()
    light = floor_from_above(
        '<light type="spot" pos="0 0 2" dir="0 0 -1" cutoff="89" exponent="0" diffuse="1 1 1"'
        ' attenuation="1 .5 .25"/>'
    )
    r = np.sqrt(x**2 + y**2 + 4)
    np.testing.assert_allclose(
        light, linear(0.5) * (2 / r) / (1 + 0.5 * r + 0.25 * r**2), rtol=1e-4
    )


def test_spot_has_an_edge_and_an_exponent() -> None:
    x, y = pixel_centres()
    light = floor_from_above(
        '<light type="spot" pos="0 0 2" dir="0 0 -1" cutoff="20" exponent="8" diffuse="1 1 1"/>'
    )
    cosine = 2 / np.sqrt(x**2 + y**2 + 4)
    inside = cosine >= np.cos(np.deg2rad(20))
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_allclose(light[inside], (linear(0.5) * cosine**9)[inside], rtol=1e-4)
    assert (light[~inside] == 0).all()


@pytest.mark.parametrize(
    "light",
    ['type="directional" dir="0 0 -1"', 'type="spot" pos="0 0 4" dir="0 0 -1" cutoff="60"'],
    ids=["directional", "spot"],
)
def test_a_ball_throws_its_shadow(light: str) -> None:
    x, y = pixel_centres()
    ball = '<geom type="sphere" size=".25" pos="0 0 1"/>'
    lamp = f'<light {light} diffuse="1 1 1" exponent="0" castshadow="{{}}"/>'
    # seen from below the ball, so that it does not hide its own shadow
    seen = [
        light_of(f"""{DARK}<asset>{MATT.format(0.5)}</asset><worldbody>
            <camera pos="0 0 .5" projection="orthographic" fovy="2"/>{lamp.format(cast)}
            <geom type="plane" size="9 9 .1" material="matt"/>{ball}</worldbody>""")
        for cast in ("true", "false")
    ]
    lit, unshadowed = seen
    # the tangent cone from the spot: radius on the floor = 4 tan(asin(.25 / 3))
    radius = 0.25 if "directional" in light else 4 * np.tan(np.arcsin(0.25 / 3))
    from_centre = np.hypot(x, y)
    assert (lit[from_centre < radius - 0.01] == 0).all()
    outside = from_centre > radius + 0.01
    np.testing.assert_array_equal(lit[outside], unshadowed[outside])
    assert (unshadowed > 0).all()


def test_mesh_and_height_field_do_not_shade_themselves() -> None:
    light = light_of(f"""{DARK}<asset>{MATT.format(0.5)}
        <mesh name="slab" vertex="-2 -2 0  2 -2 0  2 2 0  -2 2 0  0 0 -1"/>
        <hfield name="flat" nrow="20" ncol="20" size="2 2 1 .1"/></asset><worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="6"/>
        <light type="directional" dir=".8 0 -.6" diffuse="1 1 1"/>
        <geom type="mesh" mesh="slab" material="matt" pos="0 0 0"/>
        <geom type="hfield" hfield="flat" material="matt" pos="0 0 2"/></worldbody>""")
    middle = light[6:26, 6:26]
    np.testing.assert_allclose(middle, linear(0.5) * 0.6, rtol=1e-4)


def test_checker_floor_has_its_squares_where_mujoco_has_them() -> None:
    size = 64
    light = light_of(
        f"""{DARK}<asset>
        <texture name="t" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 1 1" width="256"
            height="256"/>
        <material name="m" texture="t" texrepeat="2 2" texuniform="true" specular="0"/></asset>
            <worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="2"/>
        <light type="directional" dir="0 0 -1" diffuse="1 1 1" castshadow="false"/>
        <geom type="plane" size="3 3 .1" material="m" rgba="1 1 1 1"/></worldbody>""",
        size,
    )
    x, y = pixel_centres(size)
    # MuJoCo: u = (x + sx) / (2 sx) * texrepeat * sx, so one image (two squares) a metre
    u, v = (x + 3) / 6 * 6, (1 - (y + 3) / 6) * 6
    first = (np.floor(u * 2) + np.floor(v * 2)) % 2 == 0
    # away from the squares' rims, where the image is filtered
    inner = (np.abs(u * 2 - np.round(u * 2)) > 0.1) & (np.abs(v * 2 - np.round(v * 2)) > 0.1)
    np.testing.assert_allclose(light[first & inner], 0, atol=1e-6)
    np.testing.assert_allclose(light[~first & inner], 1, rtol=1e-5)


def test_a_far_checker_floor_fades_to_its_mean() -> None:
    light = light_of(
        f"""{DARK}<asset>
        <texture name="t" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 1 1" width="64"
            height="64"/>
        <material name="m" texture="t" texrepeat="50 50" texuniform="true" specular="0"/></asset>
            <worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="40"/>
        <light type="directional" dir="0 0 -1" diffuse="1 1 1" castshadow="false"/>
        <geom type="plane" size="50 50 .1" material="m" rgba="1 1 1 1"/></worldbody>""",
        37,
    )
    # every pixel covers hundreds of squares: the mean of black and white, in linear light
    np.testing.assert_allclose(light, 0.5, atol=0.01)


def test_cube_texture_puts_its_faces_where_opengl_does() -> None:
    # six one-colour faces on a box, looked at along each axis
    faces = {"right": 0.2, "left": 0.4, "up": 0.5, "down": 0.6, "front": 0.8, "back": 1.0}
    axes = {"right": (1, 0, 0), "left": (-1, 0, 0), "up": (0, 1, 0), "down": (0, -1, 0),
            "front": (0, 0, 1), "back": (0, 0, -1)}  # fmt: skip
    spec = mujoco.MjSpec.from_string("""<mujoco><worldbody>
        <geom type="box" size=".5 .5 .5" rgba="1 1 1 1"/></worldbody></mujoco>""")
    images = b"".join(bytes([round(255 * g)] * 3) * 16 for g in faces.values())
    spec.add_texture(
        name="t",
        type=mujoco.mjtTexture.mjTEXTURE_CUBE,
        width=4,
        height=24,
        nchannel=3,
        data=list(images),
    )
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "t"
    spec.add_material(name="m", textures=textures, specular=0.0)
    spec.geoms[0].material = "m"
    model = spec.compile()
    model.vis.headlight.ambient[:] = 1
    model.vis.headlight.diffuse[:] = 0
    model.vis.headlight.specular[:] = 0
    for name, axis in axes.items():
        out = np.array(axis, float)
        x = np.cross([0, 0, 1] if abs(axis[2]) < 1 else [0, 1, 0], out)
        spec_view = CameraConfig(
            body="world", pos=tuple(3 * out), xyaxes=(*x, *np.cross(out, x)), fovy=5.0
        )
        seen = Film(model, (8, 8), spec_view).light()
        np.testing.assert_allclose(seen, linear(round(255 * faces[name]) / 255), rtol=1e-4)


def test_a_mirror_shows_what_stands_on_it() -> None:
    xml = f"""{DARK}<asset><material name="mirror" reflectance="{{}}" specular="0" rgba="0 0 0 1"/>
        <material name="glow" emission="1" specular="0" rgba="1 1 1 1"/></asset><worldbody>
        <camera pos="0 -4 1" xyaxes="1 0 0 0 0.2425 .9701" fovy="40"/>
        <geom type="plane" size="9 9 .1" material="mirror"/>
        <geom type="sphere" size=".4" pos="0 0 1" material="glow"/></worldbody>"""
    without, half = (
        light_of(xml.format(share), 64, switches=SAMPLED_OUTLINES) for share in (0, 0.5)
    )
    np.testing.assert_allclose(np.unique(without), [0, 1], atol=1e-6)
    image = half - without
    # the mirrored ball is about as large as the ball, half as bright and below it
    np.testing.assert_allclose(np.unique(image), [0, 0.5], atol=1e-6)
    assert 0.6 < (image > 0).sum() / (without > 0).sum() < 1.1
    assert np.nonzero(image)[0].min() > np.nonzero(without)[0].max()


def test_sky_is_seen_only_where_nothing_is() -> None:
    sky = """<texture type="skybox" builtin="flat" rgb1=".5 .5 .5" rgb2=".5 .5 .5"
        width="8" height="8"/>"""
    light = light_of(f"""{DARK}<asset>{sky}</asset><worldbody><camera pos="0 0 3"/>
        <geom type="sphere" size=".5"/></worldbody>""")
    assert light[16, 16] == 0
    np.testing.assert_allclose(light[0], linear(127 / 255), rtol=1e-4)


def test_headlight_follows_the_camera_and_can_be_switched_off() -> None:
    xml = f"""<visual><headlight ambient="0 0 0" diffuse=".6 .6 .6" specular="0 0 0"/></visual>
        <asset>{MATT.format(0.5)}</asset><worldbody><camera pos="0 0 3" euler="30 0 0"/>
        <geom type="plane" size="99 99 .1" material="matt"/></worldbody>"""
    np.testing.assert_allclose(light_of(xml), linear(0.5) * 0.6 * np.cos(np.deg2rad(30)), rtol=1e-4)
    assert (light_of(xml, headlight="off") == 0).all()


def test_gloss_peaks_at_the_mirror_angle() -> None:
    light = light_of(
        f"""{DARK}<asset>
        <material name="m" specular="1" shininess=".5" rgba="0 0 0 1"/></asset><worldbody>
        <camera pos="0 0 3" fovy="60"/>
        <light type="directional" dir="0 0 -1" diffuse="0 0 0" specular=".8 .8 .8"/>
        <geom type="plane" size="99 99 .1" material="m"/></worldbody>""",
        33,
    )
    x = (np.arange(33) + 0.5 - 16.5) / 33 * 2 * np.tan(np.deg2rad(30))
    view = np.stack([x, np.zeros(33), np.ones(33)], -1)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    half = view + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    np.testing.assert_allclose(light[16], 0.8 * half[:, 2] ** 64, rtol=2e-4, atol=1e-7)


def test_samples_sit_inside_the_pixel_and_average() -> None:
    # an edge through the middle of pixels: k samples see it in steps of 1 / k
    xml = f"""{DARK}<asset><material name="glow" emission="1" specular="0" rgba="1 1 1 1"/>
            </asset><worldbody>
        <camera pos="0 0 3" projection="orthographic" fovy="8"/>
        <geom type="box" size="4 9 .1" pos="-3.5 0 0" material="glow"/></worldbody>"""
    for spp in (1, 4, 16):
        light = light_of(xml, 8, spp=spp)
        np.testing.assert_allclose(light[:, :4], 1, rtol=1e-6)
        assert (light[:, 5:] == 0).all()
        # one sample in the middle lies on the edge; more of them are half on each side
        assert (np.isin(light[:, 4], (0, 1)) if spp == 1 else light[:, 4] == 0.5).all()


def test_far_from_the_origin_nothing_changes() -> None:
    scene = """{0}<asset>{1}</asset><worldbody><body pos="{2} 0 0">
        <camera pos="0 -2 1" xyaxes="1 0 0 0 .4 .9"/>
        <light type="directional" dir=".3 .5 -1" diffuse="1 1 1"/>
        <geom type="plane" size="3 3 .1" material="matt"/>
        <geom type="capsule" size=".2 .3" pos="0 .5 .4" euler="40 30 0"/></body></worldbody>"""
    near = light_of(scene.format(DARK, MATT.format(0.5), 0))
    far = light_of(scene.format(DARK, MATT.format(0.5), 100000))
    np.testing.assert_allclose(near, far, rtol=1e-4, atol=1e-5)


GREY = """<asset><texture name="grey" type="2d" builtin="flat" rgb1="{0} {0} {0}" width="4"
    height="4" colorspace="linear"/><material name="m" texture="grey" specular="0"/></asset>
    <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual><worldbody>
    <camera pos="0 0 2"/><geom type="plane" size="9 9 .1" material="m"/></worldbody>"""


@pytest.mark.parametrize("renderer", ["direct", "path", "raster"])
def test_a_texture_is_linear_where_it_is_named(renderer: str) -> None:
    film = Film(f"<mujoco>{GREY.format(64 / 255)}</mujoco>", (8, 8))

    def light_with(names: tuple[str, ...]) -> np.ndarray:
        return film.light(renderer=renderer, spp=4, linear_textures=names)

    np.testing.assert_allclose(light_with(()), linear(64 / 255), rtol=1e-5)
    np.testing.assert_allclose(light_with(("grey",)), 64 / 255, rtol=1e-5)
    with pytest.raises(EvsError, match=r"^no render.linear_textures 'gray'; there is: grey$"):
        light_with(("gray",))


@pytest.mark.parametrize("renderer", ["direct", "path", "raster"])
def test_a_point_lamp_fades_with_distance(renderer: str) -> None:
    lamp = """<light type="point" pos="0 0 2" diffuse="1 1 1" ambient=".3 .3 .3" bulbradius="0"
        attenuation="1 .5 .25"/>"""
    light = floor_from_above(lamp, renderer=renderer, bounces=0)
    x, y = pixel_centres()
    r = np.sqrt(x**2 + y**2 + 4)
    expected = linear(0.5) * (2 / r + 0.3) / (1 + 0.5 * r + 0.25 * r**2)
    # a sample of `path` is anywhere in its pixel
    np.testing.assert_allclose(light, expected, rtol=1e-4 if renderer != "path" else 0.03)


RENDERERS = ("direct", "path")


def light_by(renderer: str, xml: str, **render: object) -> np.ndarray:
    """(32, 32) luminance of an MJCF, seen by its camera, by a renderer with many samples."""
    return light_of(xml, **{"renderer": renderer, "spp": 64, **render})  # type: ignore[arg-type]


AMBIENT = """<asset><material name="floor" rgba=".5 .5 .5 1" specular="0" reflectance="{}"/>
    </asset><visual><headlight ambient=".4 .4 .4" diffuse="0 0 0" specular="0 0 0"/></visual>
    <worldbody><camera pos="0 0 2" fovy="20"/><geom type="plane" size="9 9 .1" material="floor"/>{}
    </worldbody>"""


def test_ambient_light_is_nothing_to_see() -> None:
    """Neither behind what is lit by it, nor through glass, nor in a mirror."""
    light = {
        (renderer, mirror): light_by(renderer, AMBIENT.format(mirror, "")) for renderer in RENDERERS
        for mirror in (0, 0.5)
    }  # fmt: skip
    own = 0.4 * linear(0.5)
    for mirror in (0, 0.5):
        np.testing.assert_allclose(light["direct", mirror], own, rtol=1e-5)
        # what is around shows nothing in a mirror, which takes nothing from its surface
        np.testing.assert_allclose(light["path", mirror].mean(), own, rtol=0.02)
    # a plate before nothing; glass shows what is behind it
    plate = '<geom type="plane" size=".1 .1 .1" material="floor" rgba=".5 .5 .5 {}"/>'
    alone = AMBIENT.replace('<geom type="plane" size="9 9 .1" material="floor"/>', "")
    for renderer in RENDERERS:
        for alpha in (1, 0.5):
            seen = light_by(renderer, alone.format(0, plate.format(alpha)))
            assert (seen[0] == 0).all()
            np.testing.assert_allclose(seen[12:20, 12:20].mean(), alpha * own, rtol=0.02)


def test_ambient_light_is_shaded_by_what_stands_around_in_path_alone() -> None:
    """Between two walls a path finds less of the even sky; `direct` adds it everywhere."""
    walls = "".join(
        f'<geom type="box" size=".05 2 2" pos="{x} 0 0" rgba="0 0 0 1"/>' for x in (-0.3, 0.3)
    )
    open_, narrow = (
        light_by("path", AMBIENT.format(0, more), bounces=0)[16, 12:20].mean()
        for more in ("", walls)
    )
    assert open_ == pytest.approx(0.4 * linear(0.5), rel=0.02)
    assert 0.02 < narrow / open_ < 0.4
    same = light_by("direct", AMBIENT.format(0, walls))[16, 12:20]
    np.testing.assert_allclose(same, 0.4 * linear(0.5), rtol=1e-5)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_back_of_a_plane_is_no_mirror(renderer: str) -> None:
    ball = '<geom size=".3" pos="0 0 1.5" rgba="1 1 1 1" material="glow"/>'
    scene = """<asset><material name="m" rgba="0 0 0 1" specular="0" reflectance="1"/>
        <material name="glow" emission="1" specular="0"/></asset>{}<worldbody>
        <camera pos="0 0 1" fovy="20"/>{}
        <geom type="plane" size="2 2 .1" euler="{} 0 0" material="m"/></worldbody>"""
    front, back = (light_by(renderer, scene.format(DARK, ball, turn)) for turn in (0, 180))
    # and what the ball receives of itself
    assert 0.999 < front[16, 16] < 1.05
    assert (back == 0).all()
