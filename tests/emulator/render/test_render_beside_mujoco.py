"""Our pictures beside those of MuJoCo's classic renderer: shape, and colour where it must agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from evs.drivers.pictures import write_png
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.world import extract_scene, load_model
from evs.emulator.world.meshes import face_normals
from reference.mujoco_picture import MujocoPictures, SideBySide, decoded

pytestmark = pytest.mark.statistical

ROBOTS = ("gymnasium/ant", "gymnasium/humanoid", "gymnasium/pusher", "dm_control/cheetah",
          "dm_control/humanoid_CMU", "dm_control/cartpole")  # fmt: skip


def test_robots_have_the_shape_that_mujoco_shows(robot_files, mujoco_beside: MujocoPictures):
    for name in ROBOTS:
        seen = mujoco_beside.beside(load_model(robot_files[name]), render=RenderConfig(spp=1))
        assert len(np.unique(seen.our_ids)) > 3, name
        assert seen.shape_agrees > 0.998, name


def test_cameras_of_every_kind_see_the_same(mujoco_beside: MujocoPictures):
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><light pos="0 0 3"/>
        <camera name="rolled" pos="0 -3 1" euler="70 10 20"/>
        <camera name="flat" pos="0 -3 1" euler="70 0 0" projection="orthographic" fovy="3"/>
        <geom type="plane" size="3 3 .1"/><geom type="box" size=".3 .4 .5" pos=".2 0 .5"/>
        <geom size=".2" pos="-.5 .3 .9"/></worldbody></mujoco>""")
    shifted = CameraConfig(focal_px=(90, 120), principal_px=(60, 70), distance=4, elevation=-35)
    for camera in ("rolled", "flat", shifted):
        seen = mujoco_beside.beside(model, None, camera, render=RenderConfig(spp=1))
        assert set(np.unique(seen.our_ids)) >= {0, 1, 2}
        assert seen.shape_agrees > 0.998


def test_a_difference_is_seen(mujoco_beside: MujocoPictures):
    """The test of the test: a geom that is moved by a pixel, and one of another colour."""
    xml = """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
        <worldbody><camera pos="0 0 3"/><geom type="box" size=".8 .8 .1" rgba="{} .4 .4 1"/>
        </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml.format(0.4))
    seen = mujoco_beside.beside(model)
    assert seen.shape_agrees == 1.0
    assert seen.difference(0) < 0.005
    moved = replace(seen, our_ids=np.roll(seen.our_ids, 1, 1))
    assert 0.98 < moved.shape_agrees < 0.999
    tinted = mujoco_beside.beside(mujoco.MjModel.from_xml_string(xml.format(0.42)))
    assert replace(seen, ours=tinted.ours).difference(0) == pytest.approx(0.02, abs=0.004)


AROUND = '<visual><headlight ambient="{0} {0} {0}" diffuse="0 0 0" specular="0 0 0"/></visual>'
"""Light that is the same everywhere: a geom's colour is its own, times this."""


def test_textures_have_the_colours_of_mujocos_picture(
    mujoco_beside: MujocoPictures, tmp_path: Path
):
    """A PNG without an sRGB chunk looks like the same numbers in rgba: dark wood stays dark."""
    wood = np.array([[92, 51, 23], [64, 64, 64], [200, 30, 30], [30, 60, 200]], np.uint8)
    assets, geoms, files = "", "", {}
    for number, colour in enumerate(wood):
        write_png(tmp_path / "t.png", np.tile(colour, (2, 2, 1)))
        files[f"{number}.png"] = (tmp_path / "t.png").read_bytes()
        assert b"sRGB" not in files[f"{number}.png"]
        assets += f"""<texture name="{number}" type="2d" file="{number}.png"/>
            <material name="{number}" texture="{number}"/>"""
        rgba = " ".join(str(part / 255) for part in colour)
        for x, look in ((-0.5, f'material="{number}"'), (0.5, f'rgba="{rgba} 1"')):
            at = f"{x} {0.5 * number - 0.75} 0"
            geoms += f'<geom type="box" size=".4 .2 .1" pos="{at}" {look}/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>{AROUND.format(1)}<asset>{assets}</asset><worldbody>
        <camera pos="0 0 5" projection="orthographic" fovy="2.2"/>{geoms}</worldbody></mujoco>""",
        files,
    )
    seen = mujoco_beside.beside(model)
    assert seen.shape_agrees == 1.0
    for geom, colour in enumerate(np.repeat(wood, 2, axis=0)):
        theirs, ours = seen.colours(geom)
        np.testing.assert_allclose(theirs, colour / 255, atol=0.005)
        np.testing.assert_allclose(ours, theirs, atol=0.005)


MIRRORS = {
    "plane": '<geom type="plane" size="1 1 .1" material="m"/>',
    "box from above": '<geom type="box" size="1 1 .1" pos="0 0 -.1" material="m"/>',
    "box from below": '<geom type="box" size="1 1 .1" pos="0 0 -.1" euler="180 0 0" material="m"/>',
    "glass": '<geom type="plane" size="1 1 .1" rgba=".2 .2 .2 .9" material="m"/>',
    "height field": '<geom type="hfield" hfield="h" material="m"/>',
    "sphere": '<geom size="2" pos="0 0 -2" material="m"/>',
    "ellipsoid": '<geom type="ellipsoid" size="2 2 .1" pos="0 0 -.1" material="m"/>',
    "cylinder": '<geom type="cylinder" size="1 .1" pos="0 0 -.1" material="m"/>',
    "capsule": '<geom type="capsule" size=".5 1" pos="0 0 -.5" euler="0 90 0" material="m"/>',
    "mesh": '<geom type="mesh" mesh="plate" material="m"/>',
}


@pytest.mark.parametrize("renderer", ["direct", "path"])
@pytest.mark.parametrize("kind", MIRRORS)
def test_what_mujoco_mirrors_is_a_mirror_and_nothing_else(
    kind: str, renderer: str, mujoco_beside: MujocoPictures
):
    """A red ball over something with reflectance: its image is on planes and tops of boxes."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>{AROUND.format(0.8)}<asset>
        <hfield name="h" nrow="2" ncol="2" size="1 1 .01 .1" elevation="0 0 0 0"/>
        <mesh name="plate" vertex="1 1 0 -1 1 0 1 -1 0 -1 -1 0
          1 1 -.2 -1 1 -.2 1 -1 -.2 -1 -1 -.2"/>
        <material name="m" rgba=".2 .2 .2 1" reflectance=".8" specular="0"/></asset><worldbody>
        <camera pos="0 -3 1.5" xyaxes="1 0 0 0 .5 1"/>
        <geom size=".3" pos="0 0 .6" rgba="1 0 0 1"/>{MIRRORS[kind]}</worldbody></mujoco>""")
    seen = mujoco_beside.beside(
        model,
        render=RenderConfig(renderer=renderer, spp=16, bounces=1 if renderer == "path" else 2),
    )
    assert seen.shape_agrees > 0.985
    # what the ball's light makes of dark grey is less than this
    red = [
        light[..., 0] - light[..., 1] > 0.05 for light in (decoded(seen.theirs / 255), seen.ours)
    ]
    below = [mask & (seen.our_ids == 1) & (seen.their_ids == 1) for mask in red]
    assert (below[0].sum() > 200) == (kind in ("plane", "box from above"))
    assert (below[0] == below[1])[seen.inside(1)].mean() > 0.995


def test_robots_have_their_colours_in_even_light(robot_files, mujoco_beside: MujocoPictures):
    """Where light is the same everywhere, so are their colours and ours; only what a pixel averages
    differs: black and white are grey of half the light here, of half the code there."""
    names = [name for name in ROBOTS if name != "gymnasium/humanoid"]
    compared = 0
    for name in (*names, "dm_control/walker", "dm_control/manipulator"):
        model = load_model(robot_files[name])
        model.light_active[:] = 0
        head = model.vis.headlight
        head.ambient[:], head.diffuse[:], head.specular[:], head.active = 1, 0, 0, 1
        model.mat_reflectance[:] = 0
        seen = mujoco_beside.beside(model, render=RenderConfig(spp=4, haze=False))
        for geom in np.unique(seen.our_ids):
            if seen.inside(geom).sum() < 20:
                continue
            theirs, ours = seen.colours(int(geom))
            # a checker of black and bright tiles, far away
            checker = name == "gymnasium/ant" and geom == 0
            assert (np.abs(theirs - ours).max() < 0.03) != checker, (name, geom)
            compared += 1
    assert compared > 30


def lamp_over_a_plate(light: str, headlight: str = AROUND.format(0)) -> mujoco.MjModel:
    """A small plate 1.5 m under a lamp at (0 0 2), seen from above; of albedo .5 as coded."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco>{headlight}<asset>
        <material name="m" rgba=".5 .5 .5 1" specular="0"/></asset><worldbody>
        <camera pos="0 0 1" projection="orthographic" fovy=".1"/>{light}
        <geom type="box" size=".04 .04 .5" material="m"/></worldbody></mujoco>""")


def share_of(seen: SideBySide) -> tuple[float, float]:
    """Light on the plate, as a share of one unit: theirs, ours."""
    albedo = 0.5
    theirs, ours = seen.theirs[seen.inside(0)] / 255 / albedo, seen.ours[seen.inside(0)]
    return float(np.median(theirs)), float(np.median(ours) / decoded(albedo))


@pytest.mark.parametrize(
    "attenuation", [(1, 0, 0), (2, 0, 0), (1, 0.5, 0), (0, 0, 1), (0.5, 0.4, 0.2)]
)
@pytest.mark.parametrize("renderer", ["direct", "path"])
def test_lamps_fade_as_mujocos(
    attenuation: tuple[float, ...], renderer: str, mujoco_beside: MujocoPictures
):
    """Spots in the picture of MuJoCo's classic renderer, which leaves `point` lamps out, and point
    lamps as that spot, diffuse and ambient; suns and the headlight fade nowhere."""
    said = f'attenuation="{" ".join(map(str, attenuation))}" diffuse=".6 .6 .6" ambient=".2 .2 .2"'
    said += ' specular="0 0 0" castshadow="false" bulbradius="0" pos="0 0 2"'
    render = RenderConfig(renderer=renderer, spp=16, bounces=0)
    constant, linear, square = attenuation
    expected = 0.8 / (constant + linear * 1.5 + square * 1.5**2)
    spot = f'<light type="spot" dir="0 0 -1" cutoff="80" exponent="0" {said}/>'
    theirs, ours = share_of(mujoco_beside.beside(lamp_over_a_plate(spot), render=render))
    assert theirs == pytest.approx(expected, abs=0.01)
    assert ours == pytest.approx(expected, rel=0.01)
    _, ours = share_of(
        mujoco_beside.beside(lamp_over_a_plate(f"<light type='point' {said}/>"), render=render)
    )
    assert ours == pytest.approx(expected, rel=0.01)
    sun = lamp_over_a_plate(f'<light type="directional" dir="0 0 -1" {said}/>')
    head = lamp_over_a_plate(
        "",
        '<visual><headlight ambient=".2 .2 .2" diffuse=".6 .6 .6" specular="0 0 0"/></visual>',
    )
    for model in (sun, head):
        theirs, ours = share_of(mujoco_beside.beside(model, render=render))
        assert theirs == pytest.approx(0.8, abs=0.01)
        assert ours == pytest.approx(0.8, rel=0.01)


TRACED = [
    RenderConfig(spp=4),
    RenderConfig(renderer="hybrid", spp=4),
    RenderConfig(renderer="path", spp=64),
]
SUN = '<light dir="0 0 -1" directional="true" diffuse=".5 .5 .5" castshadow="false" {}/>'
FLOOR = '<geom type="plane" size="2 2 .05" {}/>'
HIGHLIGHTS = {
    "no material": (SUN, FLOOR.format('rgba=".2 .3 .4 1"')),
    "material": (SUN, FLOOR.format('material="grey"')),
    "shiny": (SUN, FLOOR.format('material="shiny"')),
    "dark tiles": (SUN, FLOOR.format('material="dark"')),
    "box": (SUN, '<geom type="box" size="2 2 .5" pos="0 0 -.5" rgba=".2 .3 .4 1"/>'),
    "mesh": (SUN, '<geom type="mesh" mesh="ball" pos="0 0 -9" rgba=".2 .3 .4 1"/>'),
    "headlight": ("", FLOOR.format('rgba=".2 .3 .4 1"')),
    "lamp without a highlight": (
        SUN.format('specular="0 0 0"'),
        FLOOR.format('rgba=".2 .3 .4 1"'),
    ),
}


@pytest.mark.parametrize("kind", HIGHLIGHTS)
def test_highlights_are_as_bright_as_mujocos(kind: str, mujoco_beside: MujocoPictures):
    """By how much the middle is brighter than the far side, in code: a classic material shows the
    lamp's `specular`, in the colour of its texture. MuJoCo adds codes where we add light."""
    lamp, floor = HIGHLIGHTS[kind]
    shown = 0.5 if kind == "headlight" else 0
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
        <visual><headlight ambient=".2 .2 .2" diffuse="{shown} {shown} {shown}"
          specular="{shown} {shown} {shown}"/></visual>
        <asset><mesh name="ball" builtin="sphere" params="4" scale="9 9 9"/>
        <texture name="dark" type="2d" builtin="flat" rgb1=".2 .3 .4" width="8" height="8"/>
        <material name="grey" rgba=".2 .3 .4 1"/><material name="dark" texture="dark"/>
        <material name="shiny" rgba=".2 .3 .4 1" specular="1" shininess="1"/></asset>
        <worldbody>{lamp.format("")}{floor}
        <camera name="c" pos="0 0 1.2" fovy="80"/></worldbody></mujoco>""")
    for render in TRACED:
        seen = mujoco_beside.beside(model, camera="c", render=render)
        theirs, ours = (
            picture[60, 76:84].mean() - picture[60, 2:10].mean()
            for picture in (seen.theirs.astype(float), seen.our_code.astype(float))
        )
        if kind == "lamp without a highlight":
            assert max(abs(theirs), abs(ours)) < 2, (render.renderer, theirs, ours)
        else:
            assert theirs > 3
            assert 0.2 < ours / theirs < 1.5, (render.renderer, theirs, ours)


def test_a_mirror_and_the_sky_are_as_in_mujocos_picture(mujoco_beside: MujocoPictures):
    """A bright sky lights nothing and is in no mirror, which takes nothing from its surface, unless
    it is asked to."""
    sky, even = '<texture type="skybox" builtin="flat" rgb1="1 1 1" width="8" height="8"/>', {}
    for name, asset in (("sky", sky), ("none", "")):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>{AROUND.format(1)}<asset>{asset}
            <material name="m" rgba=".5 .5 .5 1" reflectance=".7" specular="0"/></asset><worldbody>
            <geom type="plane" size="2 2 .1" rgba=".7 .5 .3 1"/>
            <geom type="box" size=".7 .7 .1" pos="0 0 .1" material="m"/>
            <camera pos="0 -3 1.5" xyaxes="1 0 0 0 .5 1"/></worldbody></mujoco>""")
        for render in TRACED:
            seen = mujoco_beside.beside(model, render=replace(render, spp=16, bounces=1))
            even[name, render.renderer] = seen.ours[seen.inside(0) | seen.inside(1)]
            theirs, ours = seen.colours(1)
            np.testing.assert_allclose(ours, theirs, atol=0.02)
            if name == "sky" and render.renderer != "direct":
                lit = replace(render, sky="light")
                assert mujoco_beside.beside(model, render=lit).colours(1)[1].min() > 0.8
    for render in TRACED:
        np.testing.assert_array_equal(even["sky", render.renderer], even["none", render.renderer])


BRIGHT = ("gymnasium/ant", "dm_control/humanoid", "dm_control/manipulator")
"""Under a pale sky, with stars in a mirror, in front of a wall."""
BRIGHT_TOO = ("gymnasium/half_cheetah", "gymnasium/humanoid", "gymnasium/pusher",
              "dm_control/cartpole", "dm_control/cheetah", "dm_control/quadruped",
              "dm_control/walker")  # fmt: skip


@pytest.mark.parametrize(
    "name", [*BRIGHT, *(pytest.param(name, marks=pytest.mark.slow) for name in BRIGHT_TOO)]
)
def test_robots_are_as_bright_as_in_mujocos_picture(
    name: str, robot_files, mujoco_beside: MujocoPictures
):
    """The mean code of what is not sky. Light that is added up, not codes, is paler on slopes."""
    means = []
    for render in TRACED:
        seen = mujoco_beside.beside(load_model(robot_files[name]), render=render)
        there = seen.our_ids >= 0
        means = [*(means or [seen.theirs[there].mean()]), seen.our_code[there].mean()]
    print(f"| {name} |", " | ".join(f"{mean:.0f}" for mean in means), "|")
    assert all(0.85 < mean / means[0] < 1.25 for mean in means), means


@pytest.mark.parametrize("points", [14, 40])
def test_hulls_have_the_normals_that_mujoco_shows(mujoco_beside: MujocoPictures, points: int):
    """Smooth where faces meet at a small angle, flat elsewhere: seen by the cosine to a lamp, which
    MuJoCo interpolates between corners."""
    rng = np.random.default_rng(points)
    corners = rng.normal(size=(points, 3))
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    vertices = " ".join(f"{v:.4f}" for v in corners.ravel())
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
        <visual><headlight ambient="0 0 0" diffuse="1 1 1" specular="0 0 0"/></visual>
        <asset><mesh name="hull" vertex="{vertices}"/>
          <material name="m" rgba=".8 .8 .8 1" specular="0"/></asset>
        <worldbody><camera pos="0 0 3"/><geom type="mesh" mesh="hull" material="m"/></worldbody>
        </mujoco>""")
    seen = mujoco_beside.beside(model, render=RenderConfig(spp=1))
    mask = seen.inside(0)
    theirs, ours = seen.theirs[mask, 0] / 255 / 0.8, seen.ours[mask, 0] / decoded(0.8)
    mesh = extract_scene(model).meshes[0]
    flat = face_normals(mesh.vertices, mesh.faces)[:, None, :]
    assert ((mesh.normals * flat).sum(-1) < 0.999).mean() > 0.3
    model.mesh_normal[:], model.mesh_facenormal[:] = 0, 0  # our normals are then the faces'
    faceted = mujoco_beside.beside(model, render=RenderConfig(spp=1)).ours[mask, 0] / decoded(0.8)
    error, of_faces = (np.quantile(np.abs(theirs - cosine), 0.9) for cosine in (ours, faceted))
    assert error < 0.06
    assert of_faces > 2.5 * error
