"""A model from a file, a MjModel or a MjSpec. What comes back is always our own copy."""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias, TypeVar

import mujoco

from evs.emulator.world.object_names import one_line
from evs.emulator.world.sameframe import keep_offsets
from evs.msgs import EvsError, nearest_first

Scene: TypeAlias = str | Path | mujoco.MjModel | mujoco.MjSpec
"""Everything that a world can be made of."""

MUJOCO_VERSION = str(mujoco.__version__)

SUFFIXES = (".xml", ".mjcf", ".mjb", ".urdf")


Loaded = TypeVar("Loaded", mujoco.MjModel, mujoco.MjSpec)


def load_model(scene: Scene) -> mujoco.MjModel:
    """Load the model of a scene. Offsets that MuJoCo takes for none stay (sameframe.py).

    Args:
        scene: A path to MJCF, URDF or MJB, a MjModel (copied) or a MjSpec (compiled).

    Raises:
        EvsError: There is no such file, MuJoCo refuses it, or `scene` is something else.
    """
    model = _load_any(scene)
    keep_offsets(model)
    return model


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
    """`path` if it is a file that MuJoCo may read, else an error that lists its neighbours."""
    if path.is_file():
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
