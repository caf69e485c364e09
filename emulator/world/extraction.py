"""mjModel to SceneModel, once: the visible geoms, what they are made of, and the lights."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import I32, Mesh, ObjectKind, SceneModel, Shape
from evs.emulator.world.deformables import Deformables
from evs.emulator.world.lights import active_lights, extract_atmosphere, extract_light, unlit_images
from evs.emulator.world.materials import Surfaces, geom_rgba, is_shown, site_rgba
from evs.emulator.world.meshes import (
    extract_height_field,
    extract_mesh,
    height_field_arrays,
    mesh_arrays,
)
from evs.emulator.world.model import check_indices, names_of
from evs.emulator.world.model_edits import DEFORMING, PartCache, arrays_of
from evs.emulator.world.tendons import Strands
from evs.msgs import EvsError

FROM_MESH = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF)


def visible_geoms(model: mujoco.MjModel) -> I32:
    """(ng,) ids of the geoms that MuJoCo shows by default: groups 0 to 2, alpha above 0."""
    shapes = {int(shape) for shape in Shape} | {int(mujoco.mjtGeom.mjGEOM_SDF)}
    return np.array(
        [
            geom
            for geom in range(model.ngeom)
            if is_shown(model.geom_group[geom], geom_rgba(model, geom))
            and int(model.geom_type[geom]) in shapes
            and not (int(model.geom_type[geom]) in FROM_MESH and model.geom_dataid[geom] < 0)
        ],
        np.int32,
    )


def visible_sites(model: mujoco.MjModel) -> I32:
    """(ns,) ids of the sites that MuJoCo shows by default: groups 0 to 2, alpha above 0."""
    return np.array(
        [
            site
            for site in range(model.nsite)
            if is_shown(model.site_group[site], site_rgba(model, site))
        ],
        np.int32,
    )


def extract_scene(
    model: mujoco.MjModel, parts: PartCache | None = None, before: SceneModel | None = None
) -> SceneModel:
    """Extract everything of the model that a renderer needs and that never moves.

    A signed distance field is shown by its mesh. A height field keeps its type and brings a mesh.
    Skins and flexes follow the geoms, then sites, then rods of tendons, ropes and slider-cranks.
    What cannot be shown is listed in `left_out`, with a LeftOutWarning each.

    Args:
        model: The model.
        parts: Meshes and textures that are reused; it keeps those that are made now.
        before: The scene of the same model before it was edited, whose warnings are not repeated.

    Raises:
        EvsError: Nothing is visible.
    """
    check_indices(model)
    parts = PartCache() if parts is None else parts
    geoms = visible_geoms(model)
    deforming, sites, strands = Deformables(model), visible_sites(model), Strands(model)
    if not len(geoms) + len(deforming) + len(sites) + len(strands):
        raise EvsError(
            f"nothing to see: none of the model's {model.ngeom} geoms is in groups 0 to 2 with "
            "alpha above 0; give the scene some geometry"
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
    surfaces = Surfaces(model, parts)
    geom_surface = [surfaces.of_geom(int(geom)) for geom in geoms]
    skybox = surfaces.skybox()
    lights = tuple(extract_light(model, int(light), surfaces) for light in active_lights(model))

    # skins and flexes follow the geoms, each a mesh that lies in the world's frame
    indices = tuple(range(len(meshes), len(meshes) + len(deforming)))
    if indices:
        sources = arrays_of(model, DEFORMING)
        shown = tuple(deforming.skins), tuple(deforming.flexes)
        meshes += parts.get("deforming", shown, sources, deforming.at_rest)
        geom_surface += [surfaces.of(*appearance) for appearance in deforming.appearances()]
    geom_surface += [surfaces.of_site(int(site)) for site in sites]
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


class LeftOutWarning(UserWarning):
    """The model has something that is not shown; the message has what, and the fix."""


def warn_left_out(lines: Sequence[str]) -> None:
    """One LeftOutWarning a line, at the place outside the emulator that made the scene."""
    if not lines:
        return
    level, frame = 2, sys._getframe(1)
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("evs.emulator."):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, LeftOutWarning, stacklevel=level)
