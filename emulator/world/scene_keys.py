"""Keys of a scene: what of a model may have other values in every episode, by the names of MJCF.

A key is KIND.NAME.ATTRIBUTE, as in `body.pole.mass`, and a letter for one of several numbers, as in
`light.lamp.diffuse.r`. What has no name in the model goes by its number. `option` and `headlight`
are there once and have no name: `option.gravity.z`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64
from evs.emulator.config import VisualConfig
from evs.emulator.world.compat import is_orthographic
from evs.emulator.world.controls import home_keyframe
from evs.emulator.world.materials import (
    BRIGHTEST,
    COLOUR_ROLES,
    UNSET,
    geom_rgba,
)
from evs.emulator.world.model import COUNTS, names_of
from evs.emulator.world.visual import DEFAULT, shows_geom
from evs.msgs import EvsError, unknown

Array = npt.NDArray[Any]

Parts = dict[int, float]
"""which of several numbers -> number"""

Rows = dict[tuple[str, int, int], Array]
"""(field of the model, first row, end) -> values"""

Objects = mujoco.mjtObj
Joints = mujoco.mjtJoint

KINDS = {
    "light": Objects.mjOBJ_LIGHT,
    "material": Objects.mjOBJ_MATERIAL,
    "geom": Objects.mjOBJ_GEOM,
    "body": Objects.mjOBJ_BODY,
    "joint": Objects.mjOBJ_JOINT,
    "actuator": Objects.mjOBJ_ACTUATOR,
    "camera": Objects.mjOBJ_CAMERA,
}
"""kind of a key -> what it is in MuJoCo"""

ONCE = ("headlight", "option")
"""Kinds that a model has once."""

INFINITE = (-np.inf, np.inf)
SOME = (0.0, 1e9)
SHARE = (0.0, 1.0)
VISIBLE = (1e-3, 1.0)
"""of an alpha: nothing appears or vanishes"""
ANGLE = (-180.0, 180.0)
"""deg"""
MASS = (1e-12, 1e12)
FOVY = (1e-3, 179.9)

FREE, BALL = int(Joints.mjJNT_FREE), int(Joints.mjJNT_BALL)
DOFS = {FREE: 6, BALL: 3}
"""degrees of freedom of a type of joint; the others have one"""

AIMED = tuple(
    int(mode)
    for mode in (
        mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY,
        mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODYCOM,
    )
)
"""modes of cameras and lights that look at a body, whatever their own orientation"""


class Edits:
    """Rows of a model that were changed, and what they were."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._kept: Rows = {}

    def rows(self, field: str, begin: int = 0, end: int | None = None) -> Array:
        """The model's own memory: rows of an array, about to be changed."""
        whole: Array = attrgetter(field)(self.model)
        end = len(whole) if end is None else end
        found = whole[begin:end]
        self._kept.setdefault((field, begin, end), found.copy())
        return found

    def row(self, field: str, index: int) -> Array:
        """One row, or number, about to be changed: (1, ...)."""
        return self.rows(field, index, index + 1)

    def undo(self) -> None:
        """Put everything back."""
        for (field, begin, end), values in self._kept.items():
            attrgetter(field)(self.model)[begin:end] = values
        self._kept.clear()

    def now(self) -> tuple[Rows, Rows]:
        """What `go_back` takes: the rows that were changed as they were, and as they are now."""
        changed = {
            (field, begin, end): attrgetter(field)(self.model)[begin:end].copy()
            for field, begin, end in self._kept
        }
        return dict(self._kept), changed

    def go_back(self, to: tuple[Rows, Rows]) -> None:
        """Make all rows what they were when `now` was called."""
        self.undo()
        kept, changed = to
        for (field, begin, end), values in changed.items():
            attrgetter(field)(self.model)[begin:end] = values
        self._kept.update(kept)

    def copy_for(self, model: mujoco.MjModel) -> Edits:
        """The same for a copy of the model."""
        other = Edits(model)
        other._kept = {place: values.copy() for place, values in self._kept.items()}
        return other


@dataclass(frozen=True)
class Attribute:
    """What objects of a kind have: one number, or several."""

    kind: str
    name: str
    parts: str
    """a letter for each number; empty: there is one"""
    within: tuple[float, float]
    """lowest and highest value"""
    read: Callable[[mujoco.MjModel, int], Sequence[float] | Array]
    """(model, id) -> the numbers that it has now"""
    put: Callable[[Edits, int, F64], None] | None = None
    """(edits, id, numbers): puts them into the model"""
    begin: Callable[[mujoco.MjModel, mujoco.MjData, int, Parts], None] | None = None
    """(model, data, id, which -> number): puts them into a state where an episode begins"""
    lacks: Callable[[mujoco.MjModel, int], str] = lambda _model, _index: ""
    """(model, id) -> why an object has no such attribute; empty: it has"""
    seen: bool = False
    """whether only geoms that are shown have it"""
    derives: bool = False
    """whether constants of the model follow from it (mj_setConst)"""
    words: Callable[[mujoco.MjModel, int], dict[str, int]] | None = None
    """(model, id) -> names of its values and the values, where it has no others"""
    field: str = ""
    """the array of the model that has to be there; MuJoCo 3.3 lacks some"""

    def missing(self, model: mujoco.MjModel, index: int, visual: VisualConfig) -> str:
        """Why an object has no such attribute in a view; empty: it has."""
        if self.seen and not shows_geom(model, index, visual):
            return "is not shown"
        return self.lacks(model, index)


@dataclass(frozen=True)
class SceneKey:
    """One number of one object."""

    name: str
    """KIND.NAME.ATTRIBUTE, and a letter if there are several numbers"""
    attribute: Attribute
    index: int
    """id of the object"""
    part: int
    """which of its numbers"""

    def read(self, model: mujoco.MjModel) -> float:
        """The value that a model has now."""
        return float(self.attribute.read(model, self.index)[self.part])

    def words(self, model: mujoco.MjModel) -> dict[str, int] | None:
        """Names of its values and the values, where it has no others."""
        words = self.attribute.words
        return None if words is None else words(model, self.index)


def find_keys(
    model: mujoco.MjModel, written: str, visual: VisualConfig = DEFAULT
) -> list[SceneKey]:
    """The keys that a text stands for.

    Args:
        model: The model.
        written: A key; NAME may have `*` for any letters and `?` for any one, and without the
            letter of a number it stands for all of them.
        visual: What is shown; hidden geoms have no colour.

    Raises:
        EvsError: It is none, with the nearest known; or nothing fits the pattern.
    """
    kind, _, rest = str(written).partition(".")
    if kind not in (*KINDS, *ONCE):
        raise unknown("kind of object", kind, (*KINDS, *ONCE))
    known = _attributes(kind)
    before, _, last = rest.rpartition(".")
    letter = ""
    if last not in known:
        name, _, word = before.rpartition(".")
        # option.gravity.z has no name before its attribute
        if word in known and last and last in known[word].parts:
            before, last, letter = name, word, last
        elif word in known:
            raise unknown(f"number of {kind} {word}", last, known[word].parts)
        else:
            raise unknown(f"attribute of a {kind}", last, known)
    attribute = known[last]
    objects = _named(model, kind, before)
    reasons = {label: attribute.missing(model, index, visual) for label, index in objects.items()}
    found = [label for label, reason in reasons.items() if not reason]
    if not found:
        label, reason = next(iter(reasons.items()))
        raise EvsError(f"{kind} '{label}' has no {last}: it {reason}")
    letters = letter or attribute.parts
    return [key for label in found for key in _keys(attribute, label, objects[label], letters)]


def every_key(model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> dict[str, SceneKey]:
    """All keys of a model in a view, by name."""
    found = {}
    for attribute in _table():
        for label, index in _labels(model, attribute.kind).items():
            if not attribute.missing(model, index, visual):
                for key in _keys(attribute, label, index, attribute.parts):
                    found[key.name] = key
    return found


def _keys(attribute: Attribute, label: str, index: int, letters: str) -> Iterator[SceneKey]:
    words = [attribute.kind, *([label] if attribute.kind in KINDS else []), attribute.name]
    name = ".".join(words)
    if not attribute.parts:
        yield SceneKey(name, attribute, index, 0)
    for letter in letters:
        yield SceneKey(f"{name}.{letter}", attribute, index, attribute.parts.index(letter))


def _attributes(kind: str) -> dict[str, Attribute]:
    return {one.name: one for one in _table() if one.kind == kind}


def _table() -> Iterator[Attribute]:
    """The attributes that this MuJoCo has."""
    return (one for one in ATTRIBUTES if not one.field or hasattr(mujoco.MjModel, one.field))


def order_of(attribute: Attribute) -> int:
    """The place of an attribute in the order in which they are put into a model."""
    return _ORDER[attribute.kind, attribute.name]


def _labels(model: mujoco.MjModel, kind: str) -> dict[str, int]:
    """Name of each object of a kind, its number where it has none -> its id."""
    if kind in ONCE:
        return {"": 0}
    count = getattr(model, COUNTS[KINDS[kind]])
    names = [mujoco.mj_id2name(model, KINDS[kind], index) for index in range(count)]
    found = {name: index for index, name in enumerate(names) if name}
    for index, name in enumerate(names):
        if not name:
            found.setdefault(str(index), index)
    return dict(sorted(found.items(), key=lambda one: one[1]))


def _named(model: mujoco.MjModel, kind: str, name: str) -> dict[str, int]:
    """The objects of this name, or that fit this pattern: name -> id. EvsError: there are none."""
    labels = _labels(model, kind)
    if name in labels:
        return {name: labels[name]}
    if kind in ONCE or not ({"*", "?"} & set(name)):
        raise unknown(kind, name, labels)
    pattern = re.escape(name).replace(r"\*", ".*").replace(r"\?", ".")
    found = {label: index for label, index in labels.items() if re.fullmatch(pattern, label)}
    if not found:
        raise EvsError(f"no {kind} fits '{name}'; {unknown(kind, name, labels)}")
    return found


def _columns(
    kind: str,
    name: str,
    field: str,
    within: tuple[float, float],
    parts: str = "",
    **more: Any,
) -> Attribute:
    """An attribute that is the first numbers of a row of an array."""
    count = max(1, len(parts))

    def read(model: mujoco.MjModel, index: int) -> Array:
        row: Array = attrgetter(field)(model)[index]
        return row.reshape(-1)[:count]

    def put(edits: Edits, index: int, values: F64) -> None:
        edits.row(field, index).reshape(-1)[:count] = values

    return Attribute(kind, name, parts, within, read, put, field=field, **more)


def _once(kind: str, name: str, field: str, within: tuple[float, float], parts: str) -> Attribute:
    """An attribute that is a whole array."""

    def put(edits: Edits, _index: int, values: F64) -> None:
        edits.rows(field)[:] = values

    def read(model: mujoco.MjModel, _index: int) -> Array:
        array: Array = attrgetter(field)(model)
        return array

    return Attribute(kind, name, parts, within, read, put)


def _dofs(name: str, field: str, **more: Any) -> Attribute:
    """An attribute that all degrees of freedom of a joint have."""

    def read(model: mujoco.MjModel, index: int) -> Array:
        array: Array = getattr(model, field)
        return array[model.jnt_dofadr[index] :][:1]

    def put(edits: Edits, index: int, values: F64) -> None:
        begin = int(edits.model.jnt_dofadr[index])
        count = DOFS.get(int(edits.model.jnt_type[index]), 1)
        edits.rows(field, begin, begin + count)[:] = values

    return Attribute("joint", name, "", SOME, read, put, **more)


def _still(_model: mujoco.MjModel, _index: int) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def _one(_model: mujoco.MjModel, _index: int) -> tuple[float]:
    return (1.0,)


def turned(quat: npt.ArrayLike, rotvec_deg: F64) -> F64:
    """A rotation turned about its own axes.

    Args:
        quat: (4,) the rotation.
        rotvec_deg: (3,) an axis in the turned frame, as long as the angle in degrees.
    """
    angle = float(np.linalg.norm(rotvec_deg))
    start = np.array(quat, np.float64)
    if not angle:
        return start
    turn, found = np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, rotvec_deg / angle, np.deg2rad(angle))
    mujoco.mju_mulQuat(found, start, turn)
    return found


def _turn(field: str) -> Callable[[Edits, int, F64], None]:
    def put(edits: Edits, index: int, values: F64) -> None:
        row = edits.row(field, index)
        row[0] = turned(row[0], values)

    return put


def _turn_light(edits: Edits, index: int, values: F64) -> None:
    row, found = edits.row("light_dir", index), np.zeros(3)
    mujoco.mju_rotVecQuat(found, row[0].astype(np.float64), turned((1, 0, 0, 0), values))
    row[0] = found


def _brighten(prefix: str, *fields: str) -> Callable[[Edits, int, F64], None]:
    def put(edits: Edits, index: int, values: F64) -> None:
        for name in fields:
            field = prefix + name
            if prefix != "light_":
                edits.rows(field)[:] *= values[0]
            elif hasattr(edits.model, field):
                edits.row(field, index)[:] *= values[0]

    return put


def _put_geom_rgb(edits: Edits, index: int, values: F64) -> None:
    _put_geom_rgba(edits, index, (*values, geom_rgba(edits.model, index)[3]))


def _put_geom_alpha(edits: Edits, index: int, values: F64) -> None:
    _put_geom_rgba(edits, index, (*geom_rgba(edits.model, index)[:3], values[0]))


def _put_geom_rgba(edits: Edits, index: int, rgba: Sequence[float]) -> None:
    row = edits.row("geom_rgba", index)
    row[0] = rgba
    if tuple(row[0].tolist()) == UNSET:
        # which would be the colour of its material
        row[0, 0] = np.nextafter(np.float32(UNSET[0]), np.float32(1.0))


def _put_mass(edits: Edits, index: int, values: F64) -> None:
    mass, inertia = edits.row("body_mass", index), edits.row("body_inertia", index)
    inertia *= values[0] / mass[0]
    mass[0] = values[0]


def _put_strength(edits: Edits, index: int, values: F64) -> None:
    for field in ("actuator_gainprm", "actuator_biasprm"):
        edits.row(field, index)[0, :3] *= values[0]


def _begin_qpos(model: mujoco.MjModel, data: mujoco.MjData, index: int, parts: Parts) -> None:
    begin = int(model.jnt_qposadr[index])
    for part, value in parts.items():
        data.qpos[begin + part] = value


def _begin_qvel(model: mujoco.MjModel, data: mujoco.MjData, index: int, parts: Parts) -> None:
    begin = int(model.jnt_dofadr[index])
    for part, value in parts.items():
        data.qvel[begin + part] = value


def _begin_turn(model: mujoco.MjModel, data: mujoco.MjData, index: int, parts: Parts) -> None:
    begin = int(model.jnt_qposadr[index]) + (3 if model.jnt_type[index] == FREE else 0)
    angles = np.array([parts.get(part, 0.0) for part in range(3)])
    data.qpos[begin : begin + 4] = turned(data.qpos[begin : begin + 4], angles)


def _start_of(field: str, count: int) -> Callable[[mujoco.MjModel, int], Array]:
    """(model, id) -> where a joint begins: at the keyframe `home`, else at qpos0."""

    def read(model: mujoco.MjModel, index: int) -> Array:
        home = home_keyframe(model)
        begin = int((model.jnt_qposadr if field == "qpos" else model.jnt_dofadr)[index])
        if home >= 0:
            rows: Array = getattr(model, f"key_{field}")
            return rows[home, begin : begin + count]
        start: Array = model.qpos0 if field == "qpos" else np.zeros(model.nv)
        return start[begin : begin + count]

    return read


def _off(model: mujoco.MjModel, index: int) -> str:
    return "" if model.light_active[index] else "is off"


def _light_aimed(model: mujoco.MjModel, index: int) -> str:
    aimed = int(model.light_mode[index]) in AIMED
    return _off(model, index) or ("shines at a body" if aimed else "")


def _camera_aimed(model: mujoco.MjModel, index: int) -> str:
    return "looks at a body" if int(model.cam_mode[index]) in AIMED else ""


def _no_fovy(model: mujoco.MjModel, index: int) -> str:
    if is_orthographic(model, index):
        return "projects in parallel"
    return "has a sensorsize and a focal length" if model.cam_sensorsize[index][1] else ""


def _no_headlight(model: mujoco.MjModel, _index: int) -> str:
    return "" if model.vis.headlight.active else "is off"


def _hidden_material(model: mujoco.MjModel, index: int) -> str:
    return "" if model.mat_rgba[index][3] > 0 else "is transparent"


def _texture_of(model: mujoco.MjModel, index: int) -> tuple[int, int]:
    """The role and the id of the image that gives a material its colour; -1: it has none."""
    images = [(int(role), int(model.mat_texid[index, role])) for role in COLOUR_ROLES]
    return next((one for one in images if one[1] >= 0), (0, -1))


def _put_texture(edits: Edits, index: int, values: F64) -> None:
    role, _ = _texture_of(edits.model, index)
    edits.row("mat_texid", index)[0, role] = int(values[0])


def _textures_like(model: mujoco.MjModel, index: int) -> dict[str, int]:
    """The textures of the type that a material has: name -> id."""
    _, own = _texture_of(model, index)
    names = names_of(model, Objects.mjOBJ_TEXTURE)
    return {
        name: texture
        for texture, name in enumerate(names)
        if model.tex_type[texture] == model.tex_type[own]
    }


def _untextured(model: mujoco.MjModel, index: int) -> str:
    return "" if _texture_of(model, index)[1] >= 0 else "has no image for its colour"


def _massless(model: mujoco.MjModel, index: int) -> str:
    return "" if model.body_mass[index] > 0 else "has no mass"


def _unplaced(model: mujoco.MjModel, index: int) -> str:
    if not index:
        return "is the world"
    first = int(model.body_jntadr[index])
    if first >= 0 and model.jnt_type[first] == FREE:
        return "has a free joint, which has the pos instead"
    return ""


def _not_scalar(model: mujoco.MjModel, index: int) -> str:
    return "has several coordinates" if int(model.jnt_type[index]) in DOFS else ""


def _not_free(model: mujoco.MjModel, index: int) -> str:
    return "" if int(model.jnt_type[index]) == FREE else "is no free joint"


def _not_turning(model: mujoco.MjModel, index: int) -> str:
    return "" if int(model.jnt_type[index]) in DOFS else "is neither a free nor a ball joint"


def _no_gain(model: mujoco.MjModel, index: int) -> str:
    gains = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE)
    biases = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)
    gain, bias = int(model.actuator_gaintype[index]), int(model.actuator_biastype[index])
    fits = gain in gains and bias in biases
    return "" if fits else "has a gain of another type than fixed or affine"


_LIT = (0.0, BRIGHTEST)

ATTRIBUTES: tuple[Attribute, ...] = (
    *(
        _columns("light", name, f"light_{name}", _LIT, "rgb", lacks=_off)
        for name in ("ambient", "diffuse", "specular")
    ),
    _columns("light", "intensity", "light_intensity", _LIT, lacks=_off),
    # after the colours, which it multiplies
    Attribute(
        *("light", "brightness", "", _LIT, _one),
        put=_brighten("light_", "ambient", "diffuse", "specular", "intensity"),
        lacks=_off,
    ),
    _columns("light", "pos", "light_pos", INFINITE, "xyz", lacks=_off, derives=True),
    Attribute(
        "light", "rotvec", "xyz", ANGLE, _still, _turn_light, lacks=_light_aimed, derives=True
    ),
    *(
        _once("headlight", name, f"vis.headlight.{name}", _LIT, "rgb")
        for name in ("ambient", "diffuse", "specular")
    ),
    Attribute(
        *("headlight", "brightness", "", _LIT, _one),
        put=_brighten("vis.headlight.", "ambient", "diffuse", "specular"),
        lacks=_no_headlight,
    ),
    _columns("material", "rgb", "mat_rgba", SHARE, "rgb"),
    Attribute(
        *("material", "alpha", "", VISIBLE),
        read=lambda model, index: model.mat_rgba[index, 3:],
        put=lambda edits, index, values: edits.row("mat_rgba", index).__setitem__(
            (0, 3), values[0]
        ),
        lacks=_hidden_material,
    ),
    Attribute(
        *("material", "texture", "", SOME),
        read=lambda model, index: (_texture_of(model, index)[1],),
        put=_put_texture,
        lacks=_untextured,
        words=_textures_like,
    ),
    _columns("material", "emission", "mat_emission", _LIT),
    *(
        _columns("material", name, f"mat_{name}", SHARE)
        for name in ("specular", "shininess", "reflectance")
    ),
    # after the materials, whose colour a geom may have
    Attribute(
        *("geom", "rgb", "rgb", SHARE),
        read=lambda model, index: geom_rgba(model, index)[:3],
        put=_put_geom_rgb,
        seen=True,
    ),
    Attribute(
        *("geom", "alpha", "", VISIBLE),
        read=lambda model, index: geom_rgba(model, index)[3:],
        put=_put_geom_alpha,
        seen=True,
    ),
    _columns("geom", "friction", "geom_friction", SOME),
    Attribute(
        *("body", "mass", "", MASS),
        read=lambda model, index: model.body_mass[index : index + 1],
        put=_put_mass,
        lacks=_massless,
        derives=True,
    ),
    _columns("body", "pos", "body_pos", INFINITE, "xyz", lacks=_unplaced, derives=True),
    Attribute(
        *("body", "rotvec", "xyz", ANGLE, _still, _turn("body_quat")),
        lacks=_unplaced,
        derives=True,
    ),
    _dofs("damping", "dof_damping"),
    _dofs("frictionloss", "dof_frictionloss"),
    _dofs("armature", "dof_armature", derives=True),
    _columns("joint", "stiffness", "jnt_stiffness", SOME),
    Attribute(
        *("joint", "qpos", "", INFINITE, _start_of("qpos", 1)),
        begin=_begin_qpos,
        lacks=_not_scalar,
    ),
    Attribute(
        *("joint", "qvel", "", INFINITE, _start_of("qvel", 1)),
        begin=_begin_qvel,
        lacks=_not_scalar,
    ),
    Attribute(
        *("joint", "pos", "xyz", INFINITE, _start_of("qpos", 3)),
        begin=_begin_qpos,
        lacks=_not_free,
    ),
    Attribute(
        *("joint", "vel", "xyz", INFINITE, _start_of("qvel", 3)),
        begin=_begin_qvel,
        lacks=_not_free,
    ),
    Attribute(
        *("joint", "rotvec", "xyz", ANGLE, _still),
        begin=_begin_turn,
        lacks=_not_turning,
    ),
    Attribute("actuator", "strength", "", SOME, _one, _put_strength, lacks=_no_gain),
    _columns("camera", "pos", "cam_pos", INFINITE, "xyz", derives=True),
    Attribute(
        *("camera", "rotvec", "xyz", ANGLE, _still, _turn("cam_quat")),
        lacks=_camera_aimed,
        derives=True,
    ),
    _columns("camera", "fovy", "cam_fovy", FOVY, lacks=_no_fovy),
    _once("option", "gravity", "opt.gravity", INFINITE, "xyz"),
)
"""Everything that may have values, in the order in which they are put into a model."""

_ORDER = {(one.kind, one.name): place for place, one in enumerate(ATTRIBUTES)}
