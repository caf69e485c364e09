"""SceneValues: other values in a model that is there, and the model's own again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.config.decoding import plain_number
from evs.emulator.world.model import new_data, one_line
from evs.emulator.world.scene_keys import (
    ATTRIBUTES,
    Attribute,
    Edits,
    Parts,
    SceneKey,
    every_key,
    find_keys,
    order_of,
)
from evs.emulator.world.visual import Visual, resolve_visual
from evs.msgs import EvsError

STATISTICS = ("extent", "meansize", "meanmass", "center")
"""Statistics of a model that stay: the view of a free camera and the fog follow from them."""

CONSTANT = ("bvh_", "hfield_", "mesh_", "name", "oct_", "path", "skin_", "tex_", "text_")
"""How the names of arrays begin that mj_setConst leaves alone; these may be large."""


class SceneValues:
    """Puts values by key into a model, replacing those of the last episode.

        scene = evs.SceneValues(model)
        scene.put({"body.pole.mass": 0.3, "light.lamp.brightness": 0.6, "joint.hinge.qpos": 0.1})
        mujoco.mj_resetData(model, data)
        scene.start(data)

    The rest of the model does not change, including your own edits.
    """

    def __init__(self, model: mujoco.MjModel, visual: Visual | None = None) -> None:
        """Prepare for a model, without changing it.

        Args:
            model: The model that `put` changes.
            visual: Visible groups and flags; see `World`. Hidden geoms have no colour.

        Raises:
            EvsError: `visual` is invalid.
        """
        self._model, self._visual = model, resolve_visual(visual)
        self._keys: dict[str, SceneKey] = {}
        self._edits = Edits(model)
        self._inertia_is_given: bool | None = None
        self._scratch: mujoco.MjData | None = None
        self._derived: list[npt.NDArray[Any]] = []
        """memory of the model that mj_setConst may write; found when it is first needed"""
        self.values: dict[str, float] = {}
        """key -> the value that was put in last, in the order of the keys"""

    def copy_for(self, model: mujoco.MjModel) -> SceneValues:
        """The same for a copy of the model."""
        other = SceneValues(model, self._visual)
        other._keys, other.values = self._keys, dict(self.values)
        other._edits = self._edits.copy_for(model)
        other._inertia_is_given = self._inertia_is_given
        return other

    def put(self, values: Mapping[str, float]) -> None:
        """Change the model to these values; all other numbers are as before the first call.

        Constants that depend on masses and positions are computed again (mj_setConst).

        Args:
            values: Key -> value, as in `DrawnScene.values`; {}: the model's own.

        Raises:
            EvsError: No such key, or an invalid value. Nothing has changed.
        """
        with self.putting(values):
            pass

    @contextmanager
    def putting(self, values: Mapping[str, float]) -> Iterator[None]:
        """Like `put`, but if the block raises, the previous bytes of the model are restored.

        Args:
            values: See `put`.

        Raises:
            EvsError: See `put`.
        """
        checked = self.check(values)
        if checked == self.values:
            yield
            return
        derives = self._derives(checked)
        rows = self._edits.now()
        derived = [(array, array.copy()) for array in self._derivable()] if derives else []
        statistics = self._statistics(*STATISTICS, "meaninertia")
        with unchanged_on_error(self):
            try:
                try:
                    self._put(checked)
                except mujoco.FatalError as reason:
                    raise EvsError(f"these values make no model: {one_line(reason)}") from None
                yield
            except BaseException:
                for array, before in derived:
                    array[...] = before
                self._put_statistics(statistics)
                self._edits.go_back(rows)
                raise

    def check(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values as plain numbers, in the order of the keys.

        Raises:
            EvsError: No such key, or a value outside its range.
        """
        if not isinstance(values, Mapping):
            raise EvsError(f"scene is {values!r}; give {{'body.pole.mass': 0.3, ...}}")
        found = {}
        for name, value in values.items():
            key = self._key(name)
            number = plain_number(value, f"scene.{name}")
            low, high = key.attribute.within
            if not low <= number <= high:
                raise EvsError(f"scene.{name} is {number:g}; give {low:g} ... {high:g}")
            words = key.words(self._model)
            if words is not None and number not in words.values():
                known = ", ".join(f"{one} ({word})" for word, one in words.items())
                raise EvsError(f"scene.{name} is {number:g}; give one of {known}")
            found[name] = number
        return dict(sorted(found.items()))

    def start(self, data: mujoco.MjData) -> None:
        """Set the initial positions and velocities of joints, after a reset.

        Args:
            data: Data of the model; derived quantities are not computed.
        """
        for attribute, index, parts in self._grouped(self.values):
            if attribute.begin is not None:
                attribute.begin(self._model, data, index, parts)

    def _key(self, name: str) -> SceneKey:
        if not self._keys:
            self._keys = every_key(self._model, self._visual)
        if name not in self._keys:
            try:
                found = find_keys(self._model, name, self._visual)
            except EvsError as error:
                raise EvsError(f"scene.{name}: {error}") from None
            raise EvsError(f"scene.{name} is no single number; give {found[0].name}")
        return self._keys[name]

    def _grouped(self, values: Mapping[str, float]) -> list[tuple[Attribute, int, Parts]]:
        """Attribute, id and numbers of what has values, in the order of the table."""
        groups: dict[tuple[int, int], Parts] = {}
        for name, value in values.items():
            key = self._key(name)
            groups.setdefault((order_of(key.attribute), key.index), {})[key.part] = value
        return [
            (ATTRIBUTES[place], index, parts) for (place, index), parts in sorted(groups.items())
        ]

    def _put(self, values: Mapping[str, float]) -> None:
        derives = self._derives(values)
        if derives and self._inertia_is_given is None:
            self._inertia_is_given = self._is_inertia_given()
        self._edits.undo()
        for attribute, index, parts in self._grouped(values):
            if attribute.put is not None:
                # numbers without a value stay
                numbers = np.array(attribute.read(self._model, index), np.float64)
                numbers[[*parts]] = [*parts.values()]
                attribute.put(self._edits, index, numbers)
        if derives:
            self._derive()
        self.values = dict(values)

    def _derives(self, values: Mapping[str, float]) -> bool:
        """Whether constants are others with these values than with those of now."""
        return any(self._key(name).attribute.derives for name in (*self.values, *values))

    def _derivable(self) -> list[npt.NDArray[Any]]:
        """The model's memory that mj_setConst may write."""
        if not self._derived:
            names = [name for name in dir(self._model) if not name.startswith(("_", *CONSTANT))]
            found = (getattr(self._model, name) for name in names)
            self._derived = [one for one in found if isinstance(one, np.ndarray) and one.size]
        return self._derived

    def _derive(self) -> None:
        """Compute the constants again that follow from masses and places."""
        if self._scratch is None:
            self._scratch = new_data(self._model)
        given = ("meaninertia",) if self._inertia_is_given else ()
        kept = self._statistics(*STATISTICS, *given)
        mujoco.mj_setConst(self._model, self._scratch)
        self._put_statistics(kept)

    def _statistics(self, *names: str) -> dict[str, npt.NDArray[Any]]:
        """Statistics of the model by name, copies."""
        return {name: np.array(getattr(self._model.stat, name)) for name in names}

    def _put_statistics(self, values: Mapping[str, npt.NDArray[Any]]) -> None:
        for name, value in values.items():
            if value.ndim:
                getattr(self._model.stat, name)[:] = value
            else:
                setattr(self._model.stat, name, float(value))

    def _is_inertia_given(self) -> bool:
        """Whether the model's author gave its mean inertia, which then does not follow."""
        before = float(self._model.stat.meaninertia)
        self._derive()
        found, self._model.stat.meaninertia = float(self._model.stat.meaninertia), before
        return not math.isclose(found, before, rel_tol=1e-9)
