"""What a scene was made of, and whether a user has edited it since.

Poses need no watch: body, joint, geom, camera and light frames are read from the model in every
tick. Everything else of a scene is extracted once; what it was extracted from is compared. Small
arrays, a few numbers each geom, material, light or camera, are compared byte by byte at every
look; large ones by a digest, and only at a close look.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, TypeVar, cast

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator import _core

Array = npt.NDArray[Any]

SCENE = (
    *("geom_type", "geom_dataid", "geom_bodyid", "geom_group", "geom_size", "geom_matid"),
    *("geom_rgba", "body_weldid", "body_rootid", "body_mocapid"),
    *("site_type", "site_bodyid", "site_group", "site_size", "site_matid", "site_rgba"),
    *("tendon_group", "tendon_matid", "tendon_width", "tendon_rgba", "tendon_adr", "tendon_num"),
    *("tendon_limited", "tendon_range", "tendon_lengthspring", "tendon_stiffness"),
    *("tendon_stiffnesspoly", "tendon_damping", "tendon_dampingpoly", "tendon_frictionloss"),
    *("wrap_type", "wrap_objid", "actuator_trntype", "actuator_trnid", "actuator_cranklength"),
    *("body_parentid", "cam_bodyid", "cam_targetbodyid", "light_bodyid", "light_targetbodyid"),
    *("mat_texid", "mat_texuniform", "mat_texrepeat", "mat_emission", "mat_specular"),
    *("mat_shininess", "mat_reflectance", "mat_metallic", "mat_roughness", "mat_rgba"),
    *("light_active", "light_type", "light_directional", "light_texid", "light_castshadow"),
    *("light_ambient", "light_diffuse", "light_specular", "light_intensity", "light_range"),
    *("light_bulbradius", "light_attenuation", "light_cutoff", "light_exponent"),
    "light_softness",
    *("skin_group", "skin_matid", "skin_rgba", "skin_texcoordadr"),
    *("flex_dim", "flex_group", "flex_matid", "flex_rgba", "flex_radius", "flex_texcoordadr"),
    *("tex_type", "tex_colorspace", "tex_height", "tex_width", "tex_nchannel", "tex_adr"),
    *("hfield_size", "hfield_nrow", "hfield_ncol", "hfield_adr"),
    *("vis.headlight.ambient", "vis.headlight.diffuse", "vis.headlight.specular"),
    *("vis.rgba.fog", "vis.rgba.haze", "vis.rgba.slidercrank", "vis.rgba.crankbroken"),
)
"""Small arrays of a model that its scene is made of."""

OPTICS = (
    *("cam_fovy", "cam_projection", "cam_orthographic", "cam_sensorsize", "cam_intrinsic"),
    *("geom_aabb", "stat.center"),
)
"""Small arrays that a camera's pixels follow from, or where a free one stands."""

NUMBERS: Mapping[str, tuple[str, ...]] = {
    "vis.headlight": ("active",),
    "vis.map": ("fogstart", "fogend", "haze", "znear", "zfar"),
    "vis.global_": ("fovy", "orthographic", "azimuth", "elevation"),
    "vis.quality": ("numslices",),
    "vis.scale": ("slidercrank",),
    "stat": ("extent", "meansize"),
}
"""Single numbers that either follows from, by where they are."""

DEFORMING = (
    *("skin_face", "skin_vert", "skin_texcoord", "skin_bonevertid", "skin_bonevertweight"),
    *("skin_bonebindpos", "skin_bonebindquat", "flex_vert", "flex_elem", "flex_shell"),
    *("flex_texcoord", "flex_elemtexcoord", "flex_edge"),
)
"""Large arrays of skins and flexes."""

MESHES = (
    *("mesh_vert", "mesh_normal", "mesh_face", "mesh_facenormal", "mesh_texcoord"),
    *("mesh_facetexcoord", "hfield_data", "tex_data"),
)
"""Large arrays of meshes, height fields and textures."""

KINEMATICS = (
    *("body_pos", "body_quat", "body_ipos", "body_iquat", "jnt_type", "jnt_bodyid"),
    *("jnt_pos", "jnt_axis", "qpos0", "geom_pos", "geom_quat", "site_pos", "site_quat"),
    *("cam_mode", "cam_pos", "cam_quat", "light_mode", "light_pos", "light_dir"),
)
"""Arrays that, beside those of SCENE, determine where everything is at given joint positions."""

POSES = ("body_", "jnt_", "geom_", "site_", "cam_", "light_", "tendon_", "skin_", "flex_", "qpos0")
"""How the names of all arrays begin that poses follow from."""

Made = TypeVar("Made")


def arrays_of(model: mujoco.MjModel, names: Iterable[str]) -> list[Array]:
    """The model's own memory under these names; other versions of MuJoCo may lack some."""
    found: list[Array] = []
    for name in names:
        array: Any = model
        for word in name.split("."):
            array = getattr(array, word, None)
        if array is not None:
            found.append(array)
    return found


def pose_names(model: mujoco.MjModel) -> list[str]:
    """The names of all arrays of a model that poses follow from."""
    names = [name for name in dir(model) if name.startswith(POSES)]
    return [name for name in names if isinstance(getattr(model, name), np.ndarray)]


@dataclass
class _Part:
    numbers: tuple[Any, ...]
    arrays: Sequence[Array]
    digest: int
    made: Any


class PartCache:
    """What was made of large arrays, mesh by mesh and texture by texture: kept while they stay."""

    def __init__(self, share_with: PartCache | None = None) -> None:
        """Nothing is kept yet.

        Args:
            share_with: The cache of a copy of the model; parts with the same arrays are shared.
        """
        self._parts: dict[Hashable, _Part] = {}
        self._shared = dict(share_with._parts) if share_with else {}

    def get(
        self,
        key: Hashable,
        numbers: tuple[Any, ...],
        arrays: Sequence[Array],
        make: Callable[[], Made],
    ) -> Made:
        """What `make` gives, or gave when numbers and arrays were last these.

        Arrays count as they were at the last close look, whatever they hold now.
        """
        part = self._parts.get(key)
        if part is None or part.numbers != numbers:
            digest, shared = _core.digest(list(arrays)), self._shared.pop(key, None)
            same = shared is not None and (shared.numbers, shared.digest) == (numbers, digest)
            made = shared.made if shared is not None and same else make()
            self._parts[key] = part = _Part(numbers, arrays, digest, made)
        return cast(Made, part.made)

    def detach(self) -> None:
        """Take nothing of another model any more."""
        self._shared.clear()

    def forget_changed(self) -> bool:
        """A close look: forget what was made of arrays that changed. Whether any was."""
        changed = [
            key
            for key, part in self._parts.items()
            if _core.digest(list(part.arrays)) != part.digest
        ]
        for key in changed:
            del self._parts[key]
        return bool(changed)


class ModelWatch:
    """Small arrays and single numbers of one model, and what they last were known to be."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._scene = _core.Watch(arrays_of(model, SCENE))
        self._optics = _core.Watch(arrays_of(model, OPTICS))
        self._readers = []
        for place, names in NUMBERS.items():
            thing = attrgetter(place)(model)
            known = [name for name in names if hasattr(thing, name)]
            if known:
                self._readers.append((thing, attrgetter(*known)))
        self._numbers = self._read()

    def changed(self) -> bool:
        """Whether anything is not as it was known."""
        return self._scene.changed() or self._optics.changed() or self._renumbered()

    def keep(self) -> bool:
        """What is there now is known; whether more than cameras had changed."""
        more = self._scene.changed() or self._renumbered()
        self._numbers = self._read()
        self._scene.keep()
        self._optics.keep()
        return more

    def _renumbered(self) -> bool:
        now = self._read()
        # a NaN is no other number than the NaN before
        return now != self._numbers and repr(now) != repr(self._numbers)

    def _read(self) -> list[Any]:
        return [read(place) for place, read in self._readers]
