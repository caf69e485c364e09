"""The protocols of the stages between a world and its events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from evs.emulator.base.ground_truth import GroundTruth
from evs.emulator.base.scene import F32, CameraPose, SceneSnapshot
from evs.msgs import Events


class Meter(Protocol):
    """Learns how long each stage took. The emulator itself reads no clock."""

    def lap(self, stage: str) -> None:
        """The time since the previous lap belongs to `stage`."""


class NoMeter:
    """Measures nothing."""

    def lap(self, stage: str) -> None:
        """Do nothing."""


class Renderer(Protocol):
    """Light: a snapshot in, linear luminance out."""

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """(h, w) float32 linear luminance (BT.709 weights), 1 is white paper in unit light.

        In: into, (h, w) where it goes; without it the array is valid until the next call.
        """

    def reseed(self, seed: int) -> None:
        """What noise there is follows from `seed` from the next call on."""

    @property
    def rgb(self) -> F32 | None:
        """(h, w, 3) float32 linear light of the last `render`; None: colour was not asked for."""

    def ground_truth(
        self,
        snapshot: SceneSnapshot,
        pose: CameraPose,
        previous: tuple[SceneSnapshot, CameraPose] | None = None,
    ) -> GroundTruth:
        """What each pixel's centre shows, its flow since `previous`, an earlier instant."""

    @property
    def traced_fraction(self) -> float:
        """Share of the pixels that the last `render` really traced, 0 ... 1."""

    @property
    def features(self) -> Mapping[str, bool]:
        """Which code paths it runs, by the names of evs.emulator.base.features.FEATURES."""


class EventModel(Protocol):
    """Light into events. The state is a value: it can be saved, restored and compared.

    A state counts in `clamps` how often light or a value of its own was impossible and replaced.
    """

    @property
    def latency_us(self) -> int:
        """By how much its events come later than their light; their stamps carry it."""

    @property
    def warm_up_ticks(self) -> int:
        """How long it wants to have seen the first light before, where that is noisy."""

    @property
    def versions(self) -> dict[str, str]:
        """What shapes its events beside code, by name: a network's weights."""

    @property
    def features(self) -> Mapping[str, bool]:
        """Which code paths it runs, by the names of evs.emulator.base.features.FEATURES."""

    def init(self, seed: int) -> Any:
        """The state before the first tick."""

    def restore(self, saved: Mapping[str, Any]) -> Any:
        """The state whose `save()` gave these arrays. EvsError where they do not fit the model."""

    def step(
        self, luminance: F32, state: Any, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, Any]:
        """Events of the tick (t_begin_us, t_end_us], by t; the first tick only sets the reference.

        In: luminance (h, w) float32, linear, as of Renderer.render. The state given is consumed.
        """


@runtime_checkable
class ChunkedModel(EventModel, Protocol):
    """An event model that can take several ticks at once, with the same events."""

    def step_chunk(
        self, luminance: F32, state: Any, t_begin_us: int, tick_us: int
    ) -> tuple[list[Events], Any]:
        """The events of T ticks of the same length, tick by tick. In: luminance (T, h, w)."""
