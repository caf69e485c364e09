"""What a renderer gets to see is what MuJoCo itself would show: mjvScene is the oracle."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import LightKind, ObjectKind, SceneModel, Shape, TextureKind
from evs.emulator.world import SnapshotTaker, extract_scene, load_model
from evs.msgs import EvsError


def shown_by_mujoco(model, data, camera=None):
    """(geoms, lights, eye) of MuJoCo's abstract scene with default options.

    Of geoms those that have a shape of their own: ropes, and what marks things, are not among them.
    """
    view = mujoco.MjvScene(model, 5000)
    free = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, free)
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera or free, every, view)
    kinds = (mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_SKIN, mujoco.mjtObj.mjOBJ_FLEX)
    shown = view.geoms[: view.ngeom]
    ropes = np.flatnonzero(model.flex_dim == 1)
    geoms = [g for kind in kinds for g in shown if g.objtype == kind]
    geoms = [g for g in geoms if g.objtype != kinds[2] or g.objid not in ropes]
    return geoms, view.lights[: view.nlight], view.camera


def number_of(model, geom) -> int:
    """What SceneModel.geom_id has for something that MuJoCo shows."""
    if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
        return geom.objid
    return -2 - geom.objid - (model.nskin if geom.objtype == mujoco.mjtObj.mjOBJ_FLEX else 0)


def image_of(model, geom) -> int:
    """The texture that gives a geom that MuJoCo shows its colour; -1 none."""
    if geom.matid < 0:
        return -1
    rgb, rgba = mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA
    images = (model.mat_texid[geom.matid, role] for role in (rgb, rgba))
    return int(next((index for index in images if index >= 0), -1))


def type_of(light) -> int:
    """The mjtLightType of a light that MuJoCo shows; the first two are a flag in MuJoCo 3.3.0."""
    return light.type if hasattr(light, "type") else light.directional


def compare(model) -> SceneModel:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = extract_scene(model)
    snapshot = SnapshotTaker(model).snapshot(data, 0)
    geoms, lights, _ = shown_by_mujoco(model, data)
    solid = scene.geom_kind < ObjectKind.SITE
    assert [number_of(model, g) for g in geoms] == list(scene.geom_id[solid])
    assert scene.deforming == tuple(scene.geom_mesh[solid & (scene.geom_id < 0)])
    assert len(snapshot.deformed) == len(scene.deforming)
    for row, geom in enumerate(geoms):
        surface = scene.surfaces[scene.geom_surface[row]]
        assert surface.rgba == pytest.approx(tuple(geom.rgba))
        assert (surface.emission, surface.specular) == (geom.emission, geom.specular)
        assert surface.shininess == geom.shininess
        mirrors = geom.type in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX)
        assert surface.reflectance == (geom.reflectance if mirrors else 0.0)
        texid = image_of(model, geom)
        if texid >= 0:
            texture = scene.textures[surface.texture]
            assert texture.data.shape[-1] == model.tex_nchannel[texid]
            assert surface.texrepeat == tuple(model.mat_texrepeat[geom.matid])
            assert surface.texuniform == bool(model.mat_texuniform[geom.matid])
        if scene.geom_id[row] < 0:
            continue
        np.testing.assert_allclose(snapshot.geom_mat[row], geom.mat.ravel(), atol=1e-6)
        if geom.type != mujoco.mjtGeom.mjGEOM_PLANE:
            np.testing.assert_allclose(snapshot.geom_pos[row], geom.pos, atol=1e-5)
        assert (scene.geom_mesh[row] >= 0) == (scene.geom_type[row] in (Shape.MESH, Shape.HFIELD))
    assert len(lights) == len(scene.lights)
    for row, (ours, theirs) in enumerate(zip(scene.lights, lights, strict=True)):
        assert ours.kind == type_of(theirs)
        assert ours.headlight == bool(theirs.headlight)
        assert ours.castshadow == bool(theirs.castshadow)
        for name in ("ambient", "diffuse", "specular"):
            assert getattr(ours, name) == pytest.approx(tuple(getattr(theirs, name)))
        if not ours.headlight:
            np.testing.assert_allclose(snapshot.light_pos[row], theirs.pos, atol=1e-5)
            np.testing.assert_allclose(snapshot.light_dir[row], theirs.dir, atol=1e-6)
            if hasattr(theirs, "intensity"):
                assert (ours.intensity, ours.range_m) == (theirs.intensity, theirs.range)
            assert ours.bulbradius_m == theirs.bulbradius
        if ours.kind is LightKind.SPOT:
            # of point lamps, which it does not draw, MuJoCo copies none
            assert ours.attenuation == tuple(theirs.attenuation)
            assert (ours.cutoff_deg, ours.exponent) == (theirs.cutoff, theirs.exponent)
    return scene


@pytest.mark.slow
def test_every_shipped_robot_is_seen_as_mujoco_shows_it(robot_files):
    for name, path in robot_files.items():
        scene = compare(load_model(path))
        assert len(scene.geom_id) > 0, name
        assert len(scene.geom_id) == len(scene.geom_static) == len(scene.geom_surface)


RULES = """
<mujoco>
  <asset>
    <texture name="flat" type="2d" builtin="checker" rgb1="1 0 0" width="8" height="4"/>
    <texture name="one" type="cube" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="8"/>
    <texture name="unused" type="2d" builtin="flat" width="64" height="64"/>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0 0 0" rgb2="1 1 1" width="8"/>
    <material name="m" rgba=".1 .2 .3 1" texture="flat" texrepeat="3 4" specular=".25"/>
    <material name="c" texture="one" texuniform="true"/>
    <material name="clear" rgba="1 1 1 0"/>
    <mesh name="tetra" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
    <mesh name="uv" vertex="0 0 0  1 0 0  0 1 0  0 0 1" face="0 2 1  0 1 3  0 3 2  1 2 3"
      texcoord="0 0  1 0  0 1  1 1" normal="-1 -1 -1  1 0 0  0 1 0  0 0 1"/>
  </asset>
  <visual><headlight ambient=".3 .3 .3" diffuse=".2 .2 .2"/></visual>
  <worldbody>
    <light type="spot" pos="0 0 3" cutoff="30" exponent="5" attenuation="1 .5 .25"/>
    <light type="point" pos="1 0 3" attenuation="1 .5 .25" intensity="40" bulbradius=".1"/>
    <light type="directional" dir="0 1 -1" castshadow="false" attenuation="1 .5 .25"/>
    <light type="spot" active="false"/>
    <geom name="own" size=".1" material="m" rgba="1 0 0 .5"/>
    <geom name="material" size=".1" material="m"/>
    <geom name="cube" type="box" size=".1 .1 .1" material="c"/>
    <geom name="group3" size=".1" group="3"/>
    <geom name="alpha" size=".1" rgba="1 1 1 0"/>
    <geom name="clear" size=".1" material="clear"/>
    <geom name="mesh" type="mesh" mesh="tetra"/>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="still" pos="1 0 0"><geom name="welded" size=".1"/></body>
    <body name="hand" mocap="true" pos="2 0 0"><geom name="mocap" size=".1"/></body>
    <body name="free" pos="0 2 0"><freejoint/><geom name="moving" size=".1"/>
      <geom name="again" type="mesh" mesh="tetra"/><geom name="uv" type="mesh" mesh="uv"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def rules():
    model = mujoco.MjModel.from_xml_string(RULES)
    scene = compare(model)
    rows = {model.geom(int(geom)).name: row for row, geom in enumerate(scene.geom_id)}
    return scene, rows


def test_geoms_in_hidden_groups_and_without_alpha_are_left_out(rules):
    assert not {"group3", "alpha", "clear"} & set(rules[1])


def test_static_is_what_can_never_move(rules):
    scene, rows = rules
    moving = {name for name, row in rows.items() if not scene.geom_static[row]}
    assert moving == {"mocap", "moving", "again", "uv"}


def test_the_geoms_own_colour_wins_over_its_material(rules):
    scene, rows = rules
    own = scene.surfaces[scene.geom_surface[rows["own"]]]
    assert own.rgba == (1.0, 0.0, 0.0, 0.5)
    assert own.texture >= 0
    assert own.specular == 0.25


def test_only_textures_in_use_are_kept_and_cubes_have_six_faces(rules):
    scene, _ = rules
    kinds = [texture.kind for texture in scene.textures]
    assert sorted(kinds) == [TextureKind.FLAT, TextureKind.CUBE, TextureKind.SKYBOX]
    assert scene.textures[kinds.index(TextureKind.FLAT)].data.shape == (4, 8, 3)
    assert scene.textures[kinds.index(TextureKind.CUBE)].data.shape == (6, 8, 8, 3)
    assert scene.textures[scene.skybox].kind is TextureKind.SKYBOX
    assert all(texture.srgb for texture in scene.textures)


def test_attenuation_belongs_to_lamps_in_a_place(rules):
    lights = {light.kind: light for light in rules[0].lights if not light.headlight}
    assert lights[LightKind.SPOT].attenuation == (1.0, 0.5, 0.25)
    assert lights[LightKind.POINT].attenuation == (1.0, 0.5, 0.25)
    assert lights[LightKind.DIRECTIONAL].attenuation == (1.0, 0.0, 0.0)
    assert rules[0].lights[0].headlight
    assert len(rules[0].lights) == 4


def test_a_mesh_is_kept_once_with_flat_normals_at_hard_edges(rules):
    scene, rows = rules
    assert scene.geom_mesh[rows["mesh"]] == scene.geom_mesh[rows["again"]]
    assert len(scene.meshes) == 2
    mesh = scene.meshes[scene.geom_mesh[rows["mesh"]]]
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, np.repeat(face[:, None], 3, axis=1), atol=1e-6)
    assert mesh.texcoords is None


def test_a_mesh_with_texture_coordinates_keeps_its_own_normals(rules):
    scene, rows = rules
    mesh = scene.meshes[scene.geom_mesh[rows["uv"]]]
    assert mesh.texcoords.shape == (4, 3, 2)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1.0, atol=1e-6)
    # one normal a vertex, the same in each of its three faces
    for vertex in range(4):
        shared = mesh.normals[mesh.faces == vertex]
        np.testing.assert_array_equal(shared, np.repeat(shared[:1], 3, axis=0))
    assert len(np.unique(mesh.normals.reshape(-1, 3).round(4), axis=0)) == 4


def test_nothing_visible_is_an_error():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1' group='4'/></worldbody></mujoco>"
    )
    with pytest.raises(EvsError, match=r"nothing to see: no geom of the model \(1 in all\)"):
        extract_scene(model)


@pytest.mark.parametrize("space", ["auto", "linear", "sRGB"])
def test_images_of_colour_are_display_coded_and_maps_are_numbers(space):
    """Whatever the model says: it says the same of an author's choice and of a PNG's silence."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>
        <texture name="t" type="2d" builtin="flat" width="4" height="4" colorspace="{space}"/>
        <texture name="sky" type="skybox" builtin="flat" width="4" height="4"
          colorspace="{space}"/>
        <material name="m"><layer role="rgb" texture="t"/><layer role="normal" texture="t"/>
          <layer role="roughness" texture="t"/><layer role="emissive" texture="t"/>
        </material></asset><worldbody><geom size="1" material="m"/></worldbody></mujoco>"""
    )
    scene = extract_scene(model)
    surface = scene.surfaces[scene.geom_surface[0]]
    for index in (surface.texture, surface.emissive_map, scene.skybox):
        assert scene.textures[index].srgb
    for index in (surface.normal_map, surface.roughness_map):
        assert not scene.textures[index].srgb
    assert scene.textures[surface.texture].name == "t"
    assert scene.texture_names == ("t", "sky")
