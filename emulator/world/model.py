"""A MuJoCo model: loaded from a file, a MjModel or a MjSpec, looked up by name, checked, digested.

What loading returns is always our own copy.
"""

from __future__ import annotations

import copy
import hashlib
import logging
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.package_paths import in_package
from evs.emulator.base.scene import U8
from evs.emulator.base.small_files import is_file
from evs.emulator.world.compat import ACTUATOR_COUNT
from evs.msgs import EvsError, nearest_first, unknown

Scene: TypeAlias = str | Path | mujoco.MjModel | mujoco.MjSpec
"""Everything that a world can be made of."""

MUJOCO_VERSION = str(mujoco.__version__)

SUFFIXES = (".xml", ".mjcf", ".mjb", ".urdf")


Loaded = TypeVar("Loaded", mujoco.MjModel, mujoco.MjSpec)


def load_model(scene: Scene) -> mujoco.MjModel:
    """Load the model of a scene. Offsets that MuJoCo takes for none stay (keep_offsets).

    Args:
        scene: A path to MJCF, URDF or MJB (evs:PATH and PACKAGE:PATH: in an installed package), a
            MjModel (copied) or a MjSpec (compiled).

    Raises:
        EvsError: There is no such file, MuJoCo refuses it, or `scene` is something else.
    """
    model = _load_any(scene)
    check_model(model)
    keep_offsets(model)
    return model


def new_data(model: mujoco.MjModel) -> mujoco.MjData:
    """Make the data of a model, at qpos0.

    Raises:
        EvsError: It does not fit in memory.
    """
    try:
        return mujoco.MjData(model)
    except (mujoco.FatalError, MemoryError) as reason:
        raise EvsError(
            f"the model's state does not fit: {one_line(reason)}; give the model less memory "
            "(<size memory=.../>), or raise the limit of this shell or container (ulimit -v)"
        ) from None


def _load_any(scene: Scene) -> mujoco.MjModel:
    if isinstance(scene, mujoco.MjModel):
        return copy.copy(scene)
    if isinstance(scene, mujoco.MjSpec):
        return _load("MjSpec", scene.compile)
    if not isinstance(scene, str | Path):
        raise EvsError(
            f"a scene is a path, a mujoco.MjModel or a mujoco.MjSpec, not {type(scene).__name__}"
        )
    path = _existing(Path(scene))
    if path.suffix.lower() == ".mjb":
        return _load_binary(path)
    model = _load(str(path), lambda: mujoco.MjModel.from_xml_path(str(path)))
    if path.suffix.lower() == ".urdf" and not model.ngeom:
        raise EvsError(
            f"{path}: nothing to see: MuJoCo leaves a URDF's visuals out unless its <robot> has "
            '<mujoco><compiler discardvisual="false"/></mujoco>'
        )
    return model


def _load_binary(path: Path) -> mujoco.MjModel:
    """The model of an MJB file, which only the MuJoCo that wrote it reads."""
    try:
        return _load(str(path), lambda: mujoco.MjModel.from_binary_path(str(path)))
    except EvsError as error:
        raise EvsError(
            f"{error}; the file is damaged, or of another MuJoCo than this {MUJOCO_VERSION}: write "
            "it anew from its MJCF (mujoco.mj_saveModel)"
        ) from None


def load_spec(path: str | Path) -> mujoco.MjSpec:
    """The specification of an MJCF or URDF file, to be changed before it is compiled. EvsError."""
    file = _existing(Path(path))
    return _load(str(file), lambda: mujoco.MjSpec.from_file(str(file)))


def load_text(text: str, files: Mapping[str, bytes]) -> mujoco.MjModel:
    """Load the model of an MJCF text, without a file: the same model to the last byte every time.

    Args:
        text: The MJCF.
        files: Name -> content of every file that it names.

    Raises:
        EvsError: MuJoCo refuses it.
    """
    return load_model(_load("MJCF", lambda: mujoco.MjSpec.from_string(text, assets=dict(files))))


def _existing(path: Path) -> Path:
    """The file that MuJoCo may read at a path, else an error that lists its neighbours."""
    path = Path(in_package(str(path)))
    if is_file(path):
        if path.suffix.lower() in SUFFIXES:
            return path
        raise EvsError(f"scene '{path}' is no {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} file")
    folder = path if path.is_dir() else path.parent
    problem = f"scene '{path}' is a folder" if path.is_dir() else f"no scene file '{path}'"
    if not folder.is_dir():
        raise EvsError(f"{problem}: there is no folder '{folder}'")
    known = [entry.name for entry in folder.iterdir() if entry.suffix.lower() in SUFFIXES]
    if not known:
        raise EvsError(f"{problem}: no {' or '.join(SUFFIXES)} file in '{folder}'")
    nearest = nearest_first(path.name, known)
    shown = ", ".join(nearest[:12]) + (", ..." if len(nearest) > 12 else "")
    raise EvsError(f"{problem}; in '{folder}' there is: {shown}")


def _load(origin: str, load: Callable[[], Loaded]) -> Loaded:
    """What `load()` returns; MuJoCo's complaint becomes one line that begins with `origin`."""
    try:
        with _warnings_to_log(origin):
            loaded = load()
    except (ValueError, RuntimeError, mujoco.FatalError) as reason:
        newer = f" (in MuJoCo {MUJOCO_VERSION}; a newer one may know it)"
        hint = newer if "unrecognized" in str(reason) else ""
        raise EvsError(f"{origin}: {one_line(reason)}{hint}") from None
    return loaded


@contextmanager
def _warnings_to_log(origin: str) -> Iterator[None]:
    """While it lasts, MuJoCo's warnings go to the log `evs.world` and not into MUJOCO_LOG.TXT."""
    previous = mujoco.get_mju_user_warning()
    log = logging.getLogger("evs.world")
    mujoco.set_mju_user_warning(lambda text: log.info("%s: %s", origin, one_line(text)))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(previous)


SMALL_SHARE = 1e-4
"""An offset over this share of the geom's own radius counts; under it nothing is to be seen of it,
and the pose stays the copy that MuJoCo makes of it."""


def keep_offsets(model: mujoco.MjModel) -> None:
    """Let geoms lie where the model has them, offsets of less than a micrometre included.

    MuJoCo's compiler takes a geom less than 1e-6 m off its body's frame, or the frame of the body's
    inertia, for one that lies there (geom_sameframe), and its kinematics then copy the pose. In a
    world of micrometres that is another picture, and another motion.

    Args:
        model: Changed in place: pass a copy.
    """
    same = mujoco.mjtSameFrame
    offset = np.array(model.geom_pos)
    inertia = model.geom_sameframe == int(same.mjSAMEFRAME_INERTIA)
    offset[inertia] -= model.body_ipos[model.geom_bodyid[inertia]]
    copied = inertia | (model.geom_sameframe == int(same.mjSAMEFRAME_BODY))
    # a plane has no radius, nor any size that it would be small beside
    radius = np.where(model.geom_rbound > 0.0, model.geom_rbound, np.inf)
    seen = copied & (np.abs(offset).max(axis=1) > SMALL_SHARE * radius)
    model.geom_sameframe[seen] = int(same.mjSAMEFRAME_NONE)


COUNTS = {
    mujoco.mjtObj.mjOBJ_BODY: "nbody",
    mujoco.mjtObj.mjOBJ_JOINT: "njnt",
    mujoco.mjtObj.mjOBJ_GEOM: "ngeom",
    mujoco.mjtObj.mjOBJ_CAMERA: "ncam",
    mujoco.mjtObj.mjOBJ_LIGHT: "nlight",
    mujoco.mjtObj.mjOBJ_MATERIAL: "nmat",
    mujoco.mjtObj.mjOBJ_ACTUATOR: ACTUATOR_COUNT,
    mujoco.mjtObj.mjOBJ_KEY: "nkey",
    mujoco.mjtObj.mjOBJ_SENSOR: "nsensor",
    mujoco.mjtObj.mjOBJ_TEXTURE: "ntex",
}
"""Where the model keeps the number of objects of a kind."""


def name_of(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """The object's name, or its number where it has none."""
    return str(mujoco.mj_id2name(model, kind, index) or index)


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """A geom's name, else its number and its body's name."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    body = name_of(model, mujoco.mjtObj.mjOBJ_BODY, int(model.geom_bodyid[geom]))
    return str(name or f"{geom} of body {body}")


def names_of(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    """The names of all objects of a kind, in the order of their ids."""
    return [name_of(model, kind, index) for index in range(getattr(model, COUNTS[kind]))]


def find(model: mujoco.MjModel, kind: mujoco.mjtObj, label: str, name: str) -> int:
    """Find an object by name or number.

    Args:
        model: The model.
        kind: Of the object.
        label: What to call the kind in the error.
        name: Its name, or its number.

    Returns:
        Its id.

    Raises:
        EvsError: There is none; the message lists what there is.
    """
    index = int(mujoco.mj_name2id(model, kind, name))
    if index >= 0:
        return index
    if name.isdecimal() and int(name) < getattr(model, COUNTS[kind]):
        return int(name)
    raise unknown(label, name, names_of(model, kind))


def one_line(reason: object) -> str:
    """MuJoCo's message, which may have several lines, as one."""
    return "; ".join(line.strip() for line in str(reason).splitlines() if line.strip())


BODIES = (
    *("body_parentid", "body_rootid", "body_weldid", "geom_bodyid", "cam_bodyid", "light_bodyid"),
    *("cam_targetbodyid", "light_targetbodyid", "site_bodyid", "jnt_bodyid", "dof_bodyid"),
    *("skin_bonebodyid", "flex_vertbodyid", "flex_nodebodyid"),
)
MATERIALS = ("geom_matid", "site_matid", "skin_matid", "tendon_matid", "flex_matid")
TARGETS = {
    **dict.fromkeys(BODIES, "nbody"),
    **dict.fromkeys(MATERIALS, "nmat"),
    **dict.fromkeys(("mat_texid", "light_texid"), "ntex"),
    **dict.fromkeys(("body_jntadr", "dof_jntid"), "njnt"),
    **dict.fromkeys(("body_dofadr", "jnt_dofadr", "dof_parentid"), "nv"),
    "body_geomadr": "ngeom",
    "body_mocapid": "nmocap",
    "jnt_qposadr": "nq",
    "tendon_adr": "nwrap",
    "mesh_vertadr": "nmeshvert",
    "mesh_faceadr": "nmeshface",
    "hfield_adr": "nhfielddata",
    "tex_adr": "ntexdata",
}
"""field of mjModel -> what its values count; -1 is none"""

KINDS: dict[str, type] = {
    "geom_type": mujoco.mjtGeom,
    "site_type": mujoco.mjtGeom,
    "jnt_type": mujoco.mjtJoint,
    "light_type": getattr(mujoco, "mjtLightType", mujoco.mjtTexture),
    "tex_type": mujoco.mjtTexture,
    "wrap_type": mujoco.mjtWrap,
    "cam_mode": mujoco.mjtCamLight,
    "light_mode": mujoco.mjtCamLight,
}
"""field of mjModel -> the enumeration of its values"""

NUMBERS = (
    *("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia"),
    *("geom_pos", "geom_quat", "geom_size", "site_pos", "site_quat", "site_size"),
    *("cam_pos", "cam_quat", "light_pos", "light_dir", "jnt_pos", "jnt_axis", "qpos0"),
    *("hfield_size", "mat_texrepeat"),
)
"""fields of mjModel that have to be finite, and that nothing else checks"""

GEOM_DATA = {
    mujoco.mjtGeom.mjGEOM_HFIELD: "nhfield",
    mujoco.mjtGeom.mjGEOM_MESH: "nmesh",
    mujoco.mjtGeom.mjGEOM_SDF: "nmesh",
}
"""type of geom -> what geom_dataid counts"""


def check_model(model: mujoco.MjModel) -> None:
    """Check indices, kinds, places, sizes and names in a model.

    MuJoCo and renderers follow them blindly.

    Raises:
        EvsError: An index points to what the model does not have, a kind is none of MuJoCo's, a
            place or a size is NaN or infinite, or a name is not UTF-8.
    """
    for field, count in TARGETS.items():
        values = getattr(model, field, None)
        if values is not None:
            end = int(getattr(model, count))
            _check_range(field, np.asarray(values), -1, end, f"{count} is {end}")
    for kind, count in GEOM_DATA.items():
        rows = np.asarray(model.geom_type) == kind
        values, end = np.where(rows, np.asarray(model.geom_dataid), -1), int(getattr(model, count))
        _check_range("geom_dataid", values, -1, end, f"{count} is {end}")
    for field, kinds in KINDS.items():
        values = getattr(model, field, None)
        if values is not None:
            known = [int(kind) for kind in kinds.__members__.values()]  # type: ignore[attr-defined]
            _check_known(field, np.asarray(values), known, kinds.__name__)
    for field in NUMBERS:
        values = np.asarray(getattr(model, field))
        _refuse(field, values, ~np.isfinite(values), "which is no finite number")
    resolution = np.asarray(model.cam_resolution)
    _refuse("cam_resolution", resolution, resolution < 0, "but a camera has 0 pixels or more")
    try:
        bytes(model.names).decode()
    except UnicodeDecodeError as reason:
        begin = bytes(model.names).rfind(b"\0", 0, reason.start) + 1
        name = bytes(model.names)[begin:].partition(b"\0")[0]
        raise EvsError(
            f"the model has a name that is not UTF-8, {str(name)[1:]}: save its file as UTF-8"
        ) from None


def _check_range(field: str, values: npt.NDArray[Any], low: int, end: int, but: str) -> None:
    _refuse(field, values, (values < low) | (values >= end), f"but {but}: it points to nothing")


def _check_known(field: str, values: npt.NDArray[Any], known: list[int], kind: str) -> None:
    _refuse(field, values, ~np.isin(values, known), f"which is no {kind}")


def _refuse(field: str, values: npt.NDArray[Any], bad: npt.NDArray[Any], why: str) -> None:
    if bad.any():
        place = tuple(int(one) for one in np.argwhere(bad)[0])
        raise EvsError(
            f"model.{field}[{', '.join(map(str, place))}] is {values[place]}, {why}; put it back"
        )


def bytes_of(model: mujoco.MjModel) -> bytes:
    """Everything in the model, as an MJB file holds it."""
    return _image(model).tobytes()


def _image(model: mujoco.MjModel) -> U8:
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer


def digest_of(model: mujoco.MjModel) -> str:
    """16 hexadecimal digits of everything in the model; 0.3 ms for a humanoid of primitives."""
    return hashlib.sha256(_image(model).data).hexdigest()[:16]


class ModelDigest:
    """digest_of one model that may be edited, found again only where it was."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._last: tuple[int, str] | None = None

    def __call__(self) -> str:
        """The digest of the model in its present state; see `digest_of`."""
        image = _image(self._model)
        quick = _core.digest([image])
        if self._last is None or self._last[0] != quick:
            self._last = quick, hashlib.sha256(image.data).hexdigest()[:16]
        return self._last[1]


class LeftOutWarning(UserWarning):
    """Part of the model is not shown; the message names the part and the fix."""


def warn_left_out(lines: Sequence[str]) -> None:
    """One LeftOutWarning a line, at the place outside the emulator that made the scene."""
    if not lines:
        return
    level, frame = 2, sys._getframe(1)
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("evs.emulator."):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, LeftOutWarning, stacklevel=level)


def versions() -> dict[str, str]:
    """Versions of everything that shapes the events."""
    from evs import __version__

    return {"evs": __version__, "mujoco": MUJOCO_VERSION, "numpy": np.__version__}
