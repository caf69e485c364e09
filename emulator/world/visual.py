"""What of a model is seen: the groups and flags of MuJoCo's mjvOption."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeAlias

import mujoco
import numpy as np

from evs.emulator.base.scene import I32, Shape
from evs.emulator.config import VisualConfig
from evs.emulator.config.decoding import plain_config
from evs.emulator.world.materials import Rgba, geom_rgba, site_rgba
from evs.emulator.world.model import name_of, warn_left_out
from evs.msgs import EvsError

Visual: TypeAlias = VisualConfig | mujoco.MjvOption
"""Groups and flags: a configuration, or MuJoCo's own."""

DEFAULT = VisualConfig()

GROUPS = tuple(field.name for field in fields(VisualConfig) if field.name.endswith("group"))

FLAGS = tuple(field.name for field in fields(VisualConfig) if field.name not in GROUPS)

FROM_MESH = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF)

SHAPES = {int(shape) for shape in Shape} | {int(mujoco.mjtGeom.mjGEOM_SDF)}


def resolve_visual(visual: Visual | None) -> VisualConfig:
    """The groups and flags that hold.

    Flags of an mjvOption that add marks, such as contact points, are named in a LeftOutWarning.

    Args:
        visual: A configuration, MuJoCo's own option, or None: what a new mjvOption has.

    Raises:
        EvsError: It is something else, or a group is not 0 ... 5.
    """
    if visual is None:
        return DEFAULT
    if isinstance(visual, mujoco.MjvOption):
        return _of_option(visual)
    if not isinstance(visual, VisualConfig):
        raise EvsError(
            "visual= takes a mujoco.MjvOption or an evs.VisualConfig, not "
            f"{type(visual).__module__}.{type(visual).__name__}"
        )
    visual = plain_config(visual, "scene.visual")
    found = {}
    for name in GROUPS:
        groups = getattr(visual, name)
        if not all(0 <= group < mujoco.mjNGROUP for group in groups):
            raise EvsError(f"scene.visual.{name} is {groups}: groups are 0 ... 5")
        found[name] = tuple(sorted(set(groups)))
    return replace(visual, **found)  # type: ignore[arg-type]


def _of_option(option: mujoco.MjvOption) -> VisualConfig:
    groups = {name: tuple(np.flatnonzero(getattr(option, name)).tolist()) for name in GROUPS}
    flags = {name: bool(option.flags[_flag(name)]) for name in FLAGS}
    usual = mujoco.MjvOption()
    marks = [
        name
        for name, flag in mujoco.mjtVisFlag.__members__.items()
        if int(flag) < len(option.flags)
        and name.removeprefix("mjVIS_").lower() not in FLAGS
        and option.flags[int(flag)]
        and not usual.flags[int(flag)]
    ]
    marks += [name for name in ("label", "frame") if getattr(option, name)]
    if marks:
        warn_left_out([f"{', '.join(marks)} of the mjvOption: evs draws no such marks"])
    return VisualConfig(**groups, **flags)  # type: ignore[arg-type]


def new_option(template: mujoco.MjvOption | None = None) -> mujoco.MjvOption:
    """A new mjvOption.

    Args:
        template: The options to copy; None: those that MuJoCo begins with.
    """
    return mujoco.MjvOption() if template is None else copy.copy(template)


def option_of(visual: VisualConfig) -> mujoco.MjvOption:
    """An mjvOption with these groups and flags."""
    option = mujoco.MjvOption()
    for name in GROUPS:
        getattr(option, name)[:] = 0
        getattr(option, name)[list(getattr(visual, name))] = 1
    for name in FLAGS:
        option.flags[_flag(name)] = getattr(visual, name)
    return option


def _flag(name: str) -> int:
    return int(getattr(mujoco.mjtVisFlag, f"mjVIS_{name.upper()}"))


def is_shown(groups: Sequence[int], group: int, rgba: Rgba) -> bool:
    """Whether MuJoCo shows what is in `group` and has this colour, where `groups` are shown."""
    return min(max(0, int(group)), mujoco.mjNGROUP - 1) in groups and rgba[3] > 0.0


def faded(model: mujoco.MjModel, rgba: Rgba, visual: VisualConfig, body: int = -1) -> Rgba:
    """The colour under the flag `transparent`, which fades what can move.

    Args:
        model: The model.
        rgba: The colour without it.
        visual: Whose flag.
        body: What carries it; -1: it is a skin, flex or tendon.
    """
    if not visual.transparent or (body >= 0 and model.body_weldid[body] == 0):
        return rgba
    return (*rgba[:3], min(max(rgba[3] * float(model.vis.map.alpha), 0.0), 1.0))


def _is_hidden(model: mujoco.MjModel, visual: VisualConfig, body: int) -> bool:
    return not visual.static and model.body_weldid[body] == 0


def shows_geom(model: mujoco.MjModel, geom: int, visual: VisualConfig = DEFAULT) -> bool:
    """Whether MuJoCo shows a geom that has a shape."""
    body = int(model.geom_bodyid[geom])
    rgba = faded(model, geom_rgba(model, geom), visual, body)
    return is_shown(visual.geomgroup, model.geom_group[geom], rgba) and not _is_hidden(
        model, visual, body
    )


def visible_geoms(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> I32:
    """(ng,) ids of the geoms that MuJoCo shows: their group is seen, alpha is above 0."""
    return np.array(
        [
            geom
            for geom in range(model.ngeom)
            if shows_geom(model, geom, visual) and _has_shape(model, geom)
        ],
        np.int32,
    )


def _has_shape(model: mujoco.MjModel, geom: int) -> bool:
    kind = int(model.geom_type[geom])
    return kind in SHAPES and not (kind in FROM_MESH and model.geom_dataid[geom] < 0)


def hidden_geoms(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> dict[int, list[int]]:
    """Group -> ids of its geoms that only groups and flags hide."""
    hidden: dict[int, list[int]] = {}
    for geom in range(model.ngeom):
        if geom_rgba(model, geom)[3] > 0.0 and not shows_geom(model, geom, visual):
            group = min(max(0, int(model.geom_group[geom])), mujoco.mjNGROUP - 1)
            hidden.setdefault(group, []).append(geom)
    return dict(sorted(hidden.items()))


def describe(visual: VisualConfig) -> str:
    """Groups that are seen, and flags that are not as in a new mjvOption."""
    groups = ", ".join(
        f"{name} {' '.join(map(str, getattr(visual, name))) or 'none'}" for name in GROUPS
    )
    flags = [
        f"{name} {'on' if getattr(visual, name) else 'off'}"
        for name in FLAGS
        if getattr(visual, name) != getattr(DEFAULT, name)
    ]
    return ", ".join([groups, *flags])


MOST_NAMES = 4


def hidden_lines(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> tuple[str, ...]:
    """One line for each group with geoms that groups or flags hide: how many, and the first."""
    lines = []
    for group, geoms in hidden_geoms(model, visual).items():
        names = [name_of(model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in geoms[:MOST_NAMES]]
        more = ["..."] if len(geoms) > MOST_NAMES else []
        lines.append(f"{len(geoms)} in group {group} ({', '.join(names + more)})")
    return tuple(lines)


def visible_sites(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> I32:
    """(ns,) ids of the sites that MuJoCo shows: their group is seen, alpha is above 0."""
    found = []
    for site in range(model.nsite):
        body = int(model.site_bodyid[site])
        rgba = faded(model, site_rgba(model, site), visual, body)
        if is_shown(visual.sitegroup, model.site_group[site], rgba) and not _is_hidden(
            model, visual, body
        ):
            found.append(site)
    return np.array(found, np.int32)
