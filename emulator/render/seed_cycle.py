"""A cycle of point sets: each tick is traced with another set, and its light is their mean.

With fixed seeds a pixel has the same few samples in every tick, so its error is constant, but
large. A cycle of m point sets has m times the samples at the price of one tick's: set k mod m is
traced in tick k, and the light is the mean of the last m ticks. Still light is constant, so still
pixels stay silent. Moving light is (m - 1) / 2 ticks late; where it changes by more than the noise
of the sets explains, the middle of the cycle alone is used, so that edges stay sharp.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from evs.emulator import _core
from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, I32, CameraPose, GroundTruth, SceneSnapshot
from evs.emulator.render.native import NativeRenderer
from evs.emulator.state import Saved, number, numbers
from evs.msgs import EvsError


class SeedCycle:
    """The light of the last m ticks, and what follows from it."""

    def __init__(self, ticks: int, shape: tuple[int, int]) -> None:
        """Begin without light.

        Args:
            ticks: Point sets, m.
            shape: Of the light of a tick.
        """
        # and that of the newest set one cycle ago
        self._all = np.zeros((ticks + 1, *shape), np.float32)
        self._tick: int | None = None

    @property
    def planes(self) -> F32:
        """(m, ...) float32, the light of each set when it was traced last."""
        return self._all[:-1]

    @property
    def due(self) -> Sequence[int]:
        """The sets that the next tick traces: all of them at first, then one after the other."""
        sets = len(self.planes)
        return range(sets) if self._tick is None else ((self._tick + 1) % sets,)

    def step(self, trace: Callable[[int, F32], object]) -> None:
        """Trace the sets that are due.

        Args:
            trace: Called with a set and where its light goes.
        """
        due, begun = self.due, self._tick is not None
        before, newest = self._all[-1], self.planes[due[0]]
        if begun:
            np.copyto(before, newest)
        for place in due:
            trace(place, self.planes[place])
        if not begun:
            # nothing has changed yet
            np.copyto(before, newest)
        self._tick = due[0]

    def light(self, into: F32) -> F32:
        """The light of the last tick, in `into`."""
        _core.combine_cycle(self.planes, self._all[-1], self._tick or 0, into)
        return into

    def restart(self) -> None:
        """Forget the light: the next tick traces every set."""
        self._tick = None

    def save(self) -> Saved:
        """Named arrays of the light of every set, and which one was last."""
        begun = self._tick is not None
        return {
            "planes": self._all[: len(self._all) if begun else 0].copy(),
            **numbers(tick=self._tick if self._tick is not None else 0),
        }

    def prepare_restore(self, saved: Mapping[str, np.ndarray[Any, Any]]) -> Commit:
        """Check a saved cycle; the commit puts it in place.

        Raises:
            EvsError: It is damaged.
        """
        sets = len(self.planes)
        planes, tick = saved.get("planes"), number(saved, "tick", 0, sets - 1)
        shapes = ((0, *self._all.shape[1:]), self._all.shape)
        if planes is None or planes.dtype != np.float32 or planes.shape not in shapes:
            raise EvsError("saved state is damaged: the cycle of light is invalid; save it again")

        def commit() -> None:
            self._tick = tick if len(planes) else None
            self._all[: len(planes)] = planes

        return commit


class CycleRenderer:
    """The `path` renderer with render.seeds = "cycle": one NativeRenderer for each point set."""

    def __init__(self, renderers: Sequence[NativeRenderer]) -> None:
        """Take the renderers of the sets, in order."""
        self.renderers = tuple(renderers)
        self._latest = self.renderers[0]
        self._light = SeedCycle(len(self.renderers), self._latest.shape)
        self._out = np.zeros(self._latest.shape, np.float32)
        self._of_pixels: SeedCycle | None = None
        self._traced = 1.0
        self.built = self._latest.built

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """Render the next tick; the first one after `restart` with every point set.

        Args:
            snapshot: The world at its end.
            pose: Where the camera is.
            into: See NativeRenderer.

        Returns:
            (h, w) float32 linear luminance of the last m ticks.
        """
        due = [self.renderers[place] for place in self._light.due]
        self._light.step(lambda place, light: self.renderers[place].render(snapshot, pose, light))
        self._traced = sum(renderer.traced_fraction for renderer in due) / len(due)
        self._latest = due[-1]
        return self._light.light(self._out if into is None else into)

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """See `Renderer`."""
        del snapshot, pose
        return self._light.light(self._out)

    def trace(self, snapshot: SceneSnapshot, pose: CameraPose, pixels: I32) -> F32:
        """Trace single pixels of the next tick, in a cycle of their own.

        Args:
            snapshot: The world at its end.
            pose: Where the camera is.
            pixels: (n, 2) columns and rows inside the image; the cycle begins again when their
                number changes.

        Returns:
            (n,) float32 linear luminance; tick by tick that of `render`.
        """
        cycle = self._of_pixels
        if cycle is None or cycle.planes.shape[2] != len(pixels):
            cycle = self._of_pixels = SeedCycle(len(self.renderers), (1, len(pixels)))

        def trace(place: int, light: F32) -> None:
            light[0] = self.renderers[place].trace(snapshot, pose, pixels)

        cycle.step(trace)
        return cycle.light(np.empty((1, len(pixels)), np.float32)).reshape(-1)

    def restart(self) -> None:
        """Forget earlier ticks: the next one is traced with every point set."""
        self._light.restart()
        self._of_pixels = None

    def save(self) -> Saved:
        """Named arrays of the last ticks, which `prepare_restore` takes back."""
        return self._light.save()

    def prepare_restore(self, saved: Mapping[str, np.ndarray[Any, Any]]) -> Commit:
        """Check a saved cycle; the commit puts it in place.

        Raises:
            EvsError: It is damaged.
        """
        return self._light.prepare_restore(saved)

    def reseed(self, seed: int) -> None:
        """The noise follows from `seed` from the next call on, which should follow `restart`."""
        for renderer in self.renderers:
            renderer.reseed(seed)

    def ground_truth(
        self,
        snapshot: SceneSnapshot,
        pose: CameraPose,
        previous: tuple[SceneSnapshot, CameraPose] | None = None,
    ) -> GroundTruth:
        """See NativeRenderer: of the instant itself, not of the ticks before."""
        return self._latest.ground_truth(snapshot, pose, previous)

    @property
    def rgb(self) -> F32 | None:
        """(h, w, 3) float32 linear light, the mean of the sets; None: it was not wanted."""
        colours = [renderer.rgb for renderer in self.renderers]
        return np.mean([c for c in colours if c is not None], 0) if colours[0] is not None else None

    @property
    def traced_fraction(self) -> float:
        """See NativeRenderer."""
        return self._traced

    @property
    def features(self) -> dict[str, bool]:
        """See NativeRenderer."""
        return self._latest.features
