"""InstantLight: what renderers share whose light follows from its instant alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, CameraPose, SceneSnapshot


class InstantLight(ABC):
    """Earlier ticks leave nothing in the light, so there is nothing to forget or to save."""

    @abstractmethod
    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """See `Renderer`."""

    def restart(self) -> None:
        """Forget earlier ticks."""
        return

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """Render the instant that was rendered last, after `prepare_restore`."""
        return self.render(snapshot, pose)

    def save(self) -> dict[str, Any]:
        """Named arrays of earlier ticks: none."""
        return {}

    def prepare_restore(self, saved: Mapping[str, Any]) -> Commit:
        """Take back what `save` gave."""
        del saved
        return lambda: None
