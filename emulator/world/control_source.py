"""ControlSource: what moves a world's actuators until somebody gives a control."""

from __future__ import annotations

from evs.emulator.base.scene import F64
from evs.emulator.config import SceneConfig
from evs.emulator.world import (
    NO_KEYFRAME,
    Control,
    ControlFunction,
    MjData,
    MjModel,
    find_keyframe,
    home_keyframe,
    make_control,
    starting_keyframe,
)
from evs.msgs import EvsError


class ControlSource:
    """The control source of a scene's settings, or a function, with a seed that may change."""

    def __init__(
        self, model: MjModel, settings: SceneConfig, source: str | ControlFunction
    ) -> None:
        """Raises EvsError for what does not exist or fit."""
        if settings.control_file and source != "file":
            raise EvsError(
                f"scene.control_file '{settings.control_file}' is not used: "
                'set scene.control to "file", or leave it out'
            )
        self._model, self._settings, self._source = model, settings, source
        self.keyframe = starting_keyframe(model, settings.keyframe)
        if source == "keyframe" and settings.keyframe == NO_KEYFRAME:
            raise EvsError(
                'scene.control "keyframe" holds a keyframe: name it in scene.keyframe, not none'
            )
        if source == "keyframe":
            self.keyframe = find_keyframe(model, settings.keyframe)
        """id of the keyframe that the world starts from; -1: from qpos0"""
        if source == "auto" and not 0 <= self.keyframe == home_keyframe(model):
            self._source = "zero"
        self.seed = settings.control_seed
        self._control = self._make()

    @property
    def holds(self) -> bool:
        """Whether the controls of the starting keyframe hold."""
        return self._source in ("auto", "keyframe") and self._model.nu > 0

    def reseed(self, seed: int) -> None:
        """Random controls follow from `seed` from now on."""
        if seed != self.seed:
            self.seed = seed
            self._control = self._make()

    def __call__(self, t_us: int, data: MjData) -> F64 | None:
        """(nu,) the control of the tick that begins at t_us; None: as before."""
        return self._control(t_us, data)

    def _make(self) -> Control:
        settings = self._settings
        return make_control(
            self._model,
            self._source,
            keyframe=settings.keyframe,
            file=settings.control_file,
            rate_hz=settings.control_hz,
            seed=self.seed,
            scale=settings.control_scale,
        )
