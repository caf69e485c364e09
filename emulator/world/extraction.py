"""mjModel to SceneModel, once: the visible geoms, what they are made of, and the lights."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import I32, Mesh, ObjectKind, SceneModel, Shape
from evs.emulator.config import VisualConfig
from evs.emulator.world.deformables import Deformables
from evs.emulator.world.lights import active_lights, extract_atmosphere, extract_light, unlit_images
from evs.emulator.world.materials import Rgba, Surfaces, geom_rgba, site_rgba
from evs.emulator.world.meshes import (
    extract_height_field,
    extract_mesh,
    height_field_arrays,
    mesh_arrays,
)
from evs.emulator.world.model import check_model, names_of, warn_left_out
from evs.emulator.world.model_edits import DEFORMING, PartCache, arrays_of
from evs.emulator.world.tendons import Strands
from evs.emulator.world.visual import (
    DEFAULT,
    FROM_MESH,
    describe,
    faded,
    hidden_lines,
    visible_geoms,
    visible_sites,
)
from evs.msgs import EvsError


def extract_scene(
    model: mujoco.MjModel,
    parts: PartCache | None = None,
    before: SceneModel | None = None,
    visual: VisualConfig = DEFAULT,
) -> SceneModel:
    """Extract everything of the model that a renderer needs and that never moves.

    A signed distance field is shown by its mesh. A height field keeps its type and brings a mesh.
    Skins and flexes follow the geoms, then sites, then rods of tendons, ropes and slider-cranks.
    What cannot be shown is listed in `left_out`, with a LeftOutWarning each.

    Args:
        model: The model.
        parts: Meshes and textures that are reused; it keeps those that are made now.
        before: The scene of the same model before it was edited, whose warnings are not repeated.
        visual: Groups and flags that are seen.

    Raises:
        EvsError: Nothing is visible.
    """
    check_model(model)
    parts = PartCache() if parts is None else parts
    geoms, sites = visible_geoms(model, visual), visible_sites(model, visual)
    deforming, strands = Deformables(model, visual), Strands(model, visual)
    if not len(geoms) + len(deforming) + len(sites) + len(strands):
        raise EvsError(
            f"nothing to see: no geom of the model ({model.ngeom} in all) is in groups "
            f"{_in_words(visual.geomgroup)} with alpha above 0; give the scene some geometry"
            f"{_other_groups(model, visual)}"
        )

    # each mesh and height field once, however many geoms show it
    meshes: list[Mesh] = []
    mesh_index: dict[tuple[bool, int], int] = {}
    geom_mesh = np.full(len(geoms), -1, np.int32)
    for row, geom in enumerate(geoms):
        source, kind = int(model.geom_dataid[geom]), int(model.geom_type[geom])
        is_field = kind == mujoco.mjtGeom.mjGEOM_HFIELD
        if not is_field and kind not in FROM_MESH:
            continue
        if (is_field, source) not in mesh_index:
            mesh_index[is_field, source] = len(meshes)
            extract = extract_height_field if is_field else extract_mesh
            numbers, arrays = (height_field_arrays if is_field else mesh_arrays)(model, source)
            make = partial(extract, model, source)
            meshes.append(parts.get((is_field, source), numbers, arrays, make))
        geom_mesh[row] = mesh_index[is_field, source]

    kinds = np.asarray(model.geom_type[geoms], np.int32)
    kinds = np.where(kinds == mujoco.mjtGeom.mjGEOM_SDF, Shape.MESH, kinds)
    surfaces = Surfaces(model, parts, textured=visual.texture)

    def colour(own: Callable[[mujoco.MjModel, int], Rgba], index: int, body: int) -> Rgba:
        return faded(model, own(model, index), visual, body)

    geom_surface = [
        surfaces.of_geom(geom, colour(geom_rgba, geom, int(model.geom_bodyid[geom])))
        for geom in geoms.tolist()
    ]
    skybox = surfaces.skybox()
    lights = tuple(extract_light(model, int(light), surfaces) for light in active_lights(model))

    # skins and flexes follow the geoms, each a mesh that lies in the world's frame
    indices = tuple(range(len(meshes), len(meshes) + len(deforming)))
    if indices:
        sources = arrays_of(model, DEFORMING)
        shown = tuple(deforming.skins), tuple(deforming.flexes)
        meshes += parts.get("deforming", shown, sources, deforming.at_rest)
        geom_surface += [surfaces.of(*appearance) for appearance in deforming.appearances()]
    geom_surface += [
        surfaces.of_site(site, colour(site_rgba, site, int(model.site_bodyid[site])))
        for site in sites.tolist()
    ]
    geom_surface += [surfaces.of(*appearance) for appearance in strands.appearances]
    things = _things(model, geoms, deforming, sites, strands)
    unmeshed, many = len(sites) + len(strands), len(strands)
    left_out = (*unlit_images(model), *surfaces.unread_lines())
    warn_left_out([line for line in left_out if not before or line not in before.left_out])
    return SceneModel(
        geom_type=np.array(
            [
                *kinds,
                *(Shape.MESH for _ in indices),
                *model.site_type[sites],
                *strands.shapes,
            ],
            np.int32,
        ),
        geom_size=np.vstack(
            [
                model.geom_size[geoms],
                np.ones((len(indices), 3)),
                model.site_size[sites],
                strands.sizes,
            ]
        ).astype(np.float32),
        geom_mesh=np.array([*geom_mesh, *indices, *(-1 for _ in range(unmeshed))], np.int32),
        geom_surface=np.array(geom_surface, np.int32),
        geom_id=np.array([number for _, number in things], np.int32),
        geom_kind=np.array([thing for thing, _ in things], np.int32),
        geom_body=np.array(
            [
                *model.geom_bodyid[geoms],
                *(-1 for _ in indices),
                *model.site_bodyid[sites],
                *(-1 for _ in range(many)),
            ],
            np.int32,
        ),
        geom_static=np.array(
            [
                *_static(model, model.geom_bodyid[geoms]),
                *(False for _ in indices),
                *_static(model, model.site_bodyid[sites]),
                *(False for _ in range(many)),
            ],
            np.bool_,
        ),
        meshes=tuple(meshes),
        surfaces=tuple(surfaces.surfaces),
        textures=tuple(surfaces.textures),
        texture_names=tuple(names_of(model, mujoco.mjtObj.mjOBJ_TEXTURE)),
        lights=lights,
        skybox=skybox,
        deforming=indices,
        stretching=np.arange(len(things) - many, len(things), dtype=np.int32),
        atmosphere=extract_atmosphere(model),
        extent_m=float(model.stat.extent),
        not_mirrors=surfaces.not_mirrors,
        left_out=left_out,
        seen=describe(visual),
        hidden=hidden_lines(model, visual),
    )


def _things(
    model: mujoco.MjModel, geoms: I32, deforming: Deformables, sites: I32, strands: Strands
) -> list[tuple[ObjectKind, int]]:
    """Of each row of the scene: what it is, and its number in SceneModel.geom_id."""
    flexes = -2 - model.nskin
    first_site = flexes - model.nflex
    tendons = first_site - model.nsite
    first = {
        ObjectKind.TENDON: tendons,
        ObjectKind.ROPE: flexes,
        ObjectKind.CRANK: tendons - model.ntendon,
    }
    return [
        *((ObjectKind.GEOM, int(i)) for i in geoms),
        *((ObjectKind.SKIN, -2 - i) for i in deforming.skins),
        *((ObjectKind.FLEX, flexes - i) for i in deforming.flexes),
        *((ObjectKind.SITE, first_site - int(i)) for i in sites),
        *((thing, first[thing] - i) for thing, i in strands.things),
    ]


def _static(model: mujoco.MjModel, body: I32) -> npt.NDArray[np.bool_]:
    """(n,) True where a body is welded to the world and no mocap body carries it."""
    carried = model.body_mocapid[model.body_rootid[body]] >= 0
    return np.asarray((model.body_weldid[body] == 0) & ~carried, np.bool_)


def _in_words(groups: tuple[int, ...]) -> str:
    if groups == VisualConfig.geomgroup:
        return "0 to 2"
    return ", ".join(map(str, groups)) or "of none"


def _other_groups(model: mujoco.MjModel, visual: VisualConfig) -> str:
    """Where the geoms are that are not seen: the end of a message."""
    hidden = hidden_lines(model, visual)
    return f", or show those that it has: {', '.join(hidden)} (scene.visual)" if hidden else ""
