"""Nothing of a model is read into a scene that is not watched, and every watched byte counts."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.emulator import _core, world
from evs.emulator.config import CameraConfig
from evs.emulator.world import bind_camera, extract_scene, extraction
from evs.emulator.world.model_edits import (
    DEFORMING,
    MESHES,
    NUMBERS,
    OPTICS,
    SCENE,
    ModelWatch,
    PartCache,
    arrays_of,
)
from evs.emulator.world.snapshots import SnapshotTaker
from reference.edited import STAGE

EVERYTHING = (
    STAGE.replace(
        "<worldbody>",
        """<worldbody>
      <light name="image" type="image" texture="hide"/>
      <geom type="mesh" mesh="card" material="maps"/>""",
    )
    .replace(
        "<asset>",
        """<asset>
      <texture name="numbers" type="2d" builtin="flat" rgb1=".5 .5 1" width="4" height="4"/>
      <material name="maps">
        <layer role="rgb" texture="tiles"/><layer role="normal" texture="numbers"/>
        <layer role="orm" texture="numbers"/><layer role="emissive" texture="numbers"/>
      </material>
      <mesh name="card" vertex="0 0 0 1 0 0 0 1 0 1 1 .1" texcoord="0 0 1 0 0 1 1 1"/>""",
    )
    .replace(
        "</worldbody>",
        """<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".2 .2 .2" radius=".01" dim="2"
      pos="0 0 2" mass="1"><edge equality="true"/></flexcomp>
    </worldbody>""",
    )
)

OURS = Path(world.__file__).parent
READERS = ("extraction", "materials", "lights", "meshes", "deformables", "cameras", "snapshots",
           "tendons")  # fmt: skip
"""The modules that make scenes, snapshots and cameras of a model."""

WATCHED = {
    *SCENE,
    *OPTICS,
    *MESHES,
    *DEFORMING,
    *(f"{place}.{name}" for place, names in NUMBERS.items() for name in names),
}

FIXED = {
    *("ngeom", "nlight", "nmat", "ntex", "nmesh", "nskin", "nflex", "ncam", "nbody", "nsite"),
    *("ntendon", "nhfield", "nkey", "nq", "nmocap"),
    # where things lie in memory: no edit moves them
    *("mesh_vertadr", "mesh_vertnum", "mesh_faceadr", "mesh_facenum", "mesh_normaladr"),
    *("mesh_normalnum", "mesh_texcoordadr", "mesh_texcoordnum", "skin_vertadr", "skin_vertnum"),
    *("skin_faceadr", "skin_facenum", "flex_edgeadr", "flex_edgenum", "flex_vertadr"),
    # the snapshots' own, looked at in each of them
    *("opt.enableflags",),
}
"""Read, and not to be watched."""


class Recorder:
    """Stands for a model, or a part of it, and notes what is read of it."""

    def __init__(self, thing: Any, found: set[str], place: str = "") -> None:
        self._thing, self._found, self._place = thing, found, place

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._thing, name)
        place = f"{self._place}{name}"
        if type(value).__module__.startswith("mujoco"):
            return Recorder(value, self._found, f"{place}.")
        self._found.add(place)
        return value


def read_of(model: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Everything that is read of a model to show it."""
    found: set[str] = set()
    recorder: Any = Recorder(model, found)

    def bare(function: Any) -> Any:
        # MuJoCo's own functions want the model itself
        return lambda *args: function(*(model if arg is recorder else arg for arg in args))

    for name in dir(mujoco):
        if re.match("mj[vu]?_|MjData|MjvScene", name):
            monkeypatch.setattr(mujoco, name, bare(getattr(mujoco, name)))
    # the check reads whatever could point to nothing, and shows none of it
    monkeypatch.setattr(extraction, "check_model", bare(extraction.check_model))
    extract_scene(recorder)
    free = CameraConfig(distance=2.0)
    bounds = [bind_camera(recorder, "eye", 8, 6), bind_camera(recorder, "", 8, 6, free)]
    SnapshotTaker(recorder, bounds).snapshot(mujoco.MjData(model), 0)
    monkeypatch.undo()
    return found


def test_what_is_read_of_a_model_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    read = read_of(mujoco.MjModel.from_xml_string(EVERYTHING), monkeypatch)
    assert len(read) > 60
    assert read - WATCHED - FIXED == set()


def test_what_the_code_names_of_a_model_is_watched() -> None:
    # what no scene of a test reads stands in the code all the same
    named: set[str] = set()
    for module in READERS:
        text = (OURS / f"{module}.py").read_text()
        named |= set(re.findall(r"\bmodel\.([a-z]\w*)", text))
        named |= {f"vis.{part}" for part in re.findall(r"\bmodel\.vis\.(\w+)", text)}
    fields = {name for name in named if re.match("[a-z]+_", name)}
    assert {"geom_rgba", "mesh_vert", "cam_fovy"} <= fields
    assert fields - WATCHED - FIXED == set()
    parts = {name for name in named if name.startswith("vis.")}
    assert {name for name in parts if not any(known.startswith(name) for known in WATCHED)} == set()


def test_every_watched_number_counts() -> None:
    model = mujoco.MjModel.from_xml_string(EVERYTHING)
    watch = ModelWatch(model)
    assert not watch.changed()
    for array in arrays_of(model, (*SCENE, *OPTICS)):
        flat = array.reshape(-1)
        # the first and the last of each array
        for at in {0, flat.size - 1} if flat.size else set():
            before = flat[at]
            flat[at] = not before if flat.dtype == bool else before + 1
            assert watch.changed()
            flat[at] = before
            assert not watch.changed()
    for place, names in NUMBERS.items():
        thing = model
        for word in place.split("."):
            thing = getattr(thing, word)
        for name in names:
            before = getattr(thing, name)
            setattr(thing, name, before + 1)
            assert watch.changed(), name
            assert watch.keep() or name in ("fovy", "azimuth")
            assert not watch.changed()


def test_a_nan_that_stays_is_no_edit() -> None:
    model = mujoco.MjModel.from_xml_string(EVERYTHING)
    model.vis.global_.azimuth = model.cam_fovy[0] = np.nan
    watch = ModelWatch(model)
    assert not watch.changed()
    model.vis.global_.azimuth = 3.0
    assert watch.changed()


def test_a_watch_keeps_the_memory_that_it_looks_at() -> None:
    watch = ModelWatch(mujoco.MjModel.from_xml_string(STAGE))
    assert not watch.changed()


@pytest.mark.parametrize("size", [1, 7, 8, 31, 32, 33, 1000])
def test_the_digest_of_a_changed_byte_is_another(size: int) -> None:
    data = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    digest = _core.digest([data])
    found = {digest}
    for at in range(size):
        data[at] ^= 1
        found.add(_core.digest([data]))
        data[at] ^= 1
    assert len(found) == size + 1
    assert _core.digest([data.copy()]) == digest
    # where one array ends and the next begins counts
    assert _core.digest([data, data[:0]]) != digest != _core.digest([data[:-1], data[-1:]])


def test_parts_are_made_once_and_again_where_they_changed() -> None:
    parts, data, made = PartCache(), np.arange(8), []

    def make() -> object:
        made.append(object())
        return made[-1]

    first = parts.get("a", (1,), [data], make)
    data[3] = 9
    assert parts.get("a", (1,), [data], make) is first
    assert parts.forget_changed()
    assert not parts.forget_changed()
    second = parts.get("a", (1,), [data], make)
    assert second is not first
    assert parts.get("a", (2,), [data], make) is not second
    assert parts.get("b", (2,), [data], make) is made[-1]
    assert len(made) == 4
