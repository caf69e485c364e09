"""LiveScene: the scene of a model that its user may edit between any two ticks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from evs.emulator import _core
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.base.scene import SceneModel
from evs.emulator.config import VisualConfig
from evs.emulator.world.compat import warn_wrong_newton
from evs.emulator.world.extraction import extract_scene
from evs.emulator.world.model_edits import (
    DEFORMING,
    KINEMATICS,
    MESHES,
    OPTICS,
    SCENE,
    ModelWatch,
    PartCache,
    arrays_of,
)
from evs.emulator.world.visual import DEFAULT
from evs.msgs import EvsError


class LiveScene:
    """The scene of a model, and whether it still is.

    Where it is `outdated`, use what `extract` gives, and confirm it with `taken`. An edit that
    cannot be shown raises EvsError in every comparison until it is undone.
    """

    def __init__(self, model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> None:
        """Raises EvsError like extract_scene and warns like warn_wrong_newton."""
        warn_wrong_newton(model)
        self._model, self._parts = model, PartCache()
        self.visual = visual
        """groups and flags that are seen"""
        self._watch = ModelWatch(model)
        self.scene: SceneModel = extract_scene(model, self._parts, None, visual)
        """as it was last taken"""
        self.revision = 0
        """how often it was taken anew"""
        self._pending = self._whole = self._compare_large = False
        self._twin: tuple[mujoco.MjModel, _core.Watch] | None = None

    def copy_for(self, model: mujoco.MjModel) -> LiveScene:
        """The same scene, of a copy of the model; no edit of either shows in the other."""
        other = LiveScene.__new__(LiveScene)
        other._model, other._parts = model, PartCache(self._parts)
        other.visual = self.visual
        # its parts are known from here on
        extract_scene(model, other._parts, self.scene, self.visual)
        other._parts.detach()
        other._watch = ModelWatch(model)
        other.scene, other.revision = self.scene, self.revision
        other._pending, other._whole = self._pending, self._whole
        other._compare_large, other._twin = self._compare_large, None
        return other

    def check_data(self, data: mujoco.MjData) -> None:
        """EvsError where data is of another model; of a copy that is as the model is will do."""
        other = data.model
        if other is self._model:
            return
        if self._twin is None or other is not self._twin[0] or self._twin[1].changed():
            self._twin = None
            names = (*SCENE, *OPTICS, *KINEMATICS)
            if _contents(other, names) != _contents(self._model, names):
                raise EvsError(
                    "the data belongs to another model, recompiled, or edited since it was copied: "
                    "make a new EventCamera from data.model, or edit the model that this one was "
                    "made of"
                )
            self._twin = other, _core.Watch(arrays_of(other, names))

    def compare_large_arrays(self) -> None:
        """Let the next comparison cover meshes, height fields, textures, skins and flexes too."""
        self._compare_large = True

    @contextmanager
    def unchanged_on_error(self) -> Iterator[None]:
        """Forget what was taken within the block if it raises; the model must be as it was then.

        The scene must not be outdated, but for large arrays.
        """
        with unchanged_on_error(self, self._parts):
            try:
                yield
            except BaseException:
                self._watch.keep()
                raise

    def outdated(self, close: bool = True) -> bool:
        """Whether the model was edited since its scene was last taken.

        Args:
            close: Whether `compare_large_arrays` is followed now.
        """
        if close and self._compare_large:
            self._compare_large = False
            if self._parts.forget_changed():
                self._pending = self._whole = True
        return self._pending or self._watch.changed()

    def extract(self) -> SceneModel:
        """The scene of the model as it is now; the same one where only cameras were edited.

        Its meshes and textures are those of before where nothing of them changed. Raises EvsError.
        """
        # known from here on: what is edited meanwhile shows at the next comparison
        self._pending = True
        self._whole |= self._watch.keep()
        if not self._whole:
            return self.scene
        return extract_scene(self._model, self._parts, self.scene, self.visual)

    def taken(self, scene: SceneModel) -> None:
        """`scene` is what cameras show from now on."""
        self.scene = scene
        self.revision += 1
        self._pending = self._whole = False


def _contents(model: mujoco.MjModel, names: tuple[str, ...]) -> list[tuple[tuple[int, ...], int]]:
    """Shapes and a digest of what a model's pictures are made of."""
    arrays = arrays_of(model, (*names, *MESHES, *DEFORMING))
    return [(array.shape, _core.digest([array])) for array in arrays]
