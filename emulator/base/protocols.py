"""The protocols of the stages between a world and its events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

from evs.emulator.base.scene import F32, I32, CameraPose, GroundTruth, SceneSnapshot
from evs.msgs import Events

Commit = Callable[[], None]
"""What a method `prepare_...` returns: does what was checked, and cannot fail."""


class Meter(Protocol):
    """Measures the time of each stage. The emulator itself reads no clock."""

    def lap(self, stage: str) -> None:
        """The time since the previous lap belongs to `stage`."""


class NoMeter:
    """Measures nothing."""

    def lap(self, stage: str) -> None:
        """Do nothing."""


class Renderer(Protocol):
    """Light: a snapshot in, linear luminance out."""

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """Render one instant.

        Args:
            snapshot: The world at that instant.
            pose: Where the camera is.
            into: (h, w) float32, where the light goes; without it the array that is returned is
                valid until the next call.

        Returns:
            (h, w) float32 linear luminance (BT.709 weights); 1 is white paper in unit light.
        """

    def reseed(self, seed: int) -> None:
        """What noise there is follows from `seed` from the next call on."""

    def restart(self) -> None:
        """Forget earlier ticks: the next light is of its instant alone."""

    def save(self) -> dict[str, Any]:
        """Named arrays of earlier ticks, which `prepare_restore` takes back."""

    def prepare_restore(self, saved: Mapping[str, Any]) -> Commit:
        """Check what `save` gave; the commit puts it in place.

        Raises:
            EvsError: It is damaged.
        """

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """After a restore: the light of the tick that was last, and its instant, as in render."""

    @property
    def rgb(self) -> F32 | None:
        """(h, w, 3) float32 linear light of the last `render`; None: colour was not requested."""

    def ground_truth(
        self,
        snapshot: SceneSnapshot,
        pose: CameraPose,
        previous: tuple[SceneSnapshot, CameraPose] | None = None,
    ) -> GroundTruth:
        """Find what each pixel's centre shows.

        Args:
            snapshot: The world at an instant.
            pose: Where the camera is.
            previous: An earlier instant, since which the flow is; None: there is no flow.
        """

    @property
    def traced_fraction(self) -> float:
        """Share of the pixels that the last `render` really traced, 0 ... 1."""

    @property
    def features(self) -> Mapping[str, bool]:
        """Which code paths it runs, by the names of evs.emulator.base.features.FEATURES."""


@runtime_checkable
class DeviceRenderer(Renderer, Protocol):
    """A renderer on a GPU, whose light may stay there."""

    def device_light(self) -> Any:
        """Memory for light there, which `render` takes as `into` and NumPy as an array."""


@runtime_checkable
class TracingRenderer(Renderer, Protocol):
    """A renderer that can trace single pixels."""

    def trace(self, snapshot: SceneSnapshot, pose: CameraPose, pixels: I32) -> F32:
        """Trace single pixels of one instant.

        Args:
            snapshot: The world at that instant.
            pose: Where the camera is.
            pixels: (n, 2) columns and rows inside the image.

        Returns:
            (n,) float32 linear luminance, that of `render` in the same ticks.
        """


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

    @property
    def adjustable(self) -> tuple[str, ...]:
        """Keys of [sensor] that may change while it runs."""

    def take_over(self, state: Any, before: EventModel) -> Any:
        """Go on from the state of a model that had other values of `adjustable` until now.

        Args:
            state: Of the other model; it is consumed.
            before: That model.

        Raises:
            EvsError: They differ in more; the state has not changed.
        """

    def init(self, seed: int) -> Any:
        """The state before the first tick."""

    def restore(self, saved: Mapping[str, Any]) -> Any:
        """The state whose `save()` gave these arrays. EvsError where they do not fit the model."""

    def step(
        self, luminance: F32, state: Any, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, Any]:
        """Turn the light of one tick into events; the first tick only sets the reference.

        Args:
            luminance: (h, w) float32, linear, as in Renderer.render, at the end of the tick.
            state: From `init`, `restore` or the last `step`; it is consumed.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            The events in (t_begin_us, t_end_us], sorted by t, and the state after them.

        Raises:
            EvsError: The light has another shape, or the tick does not go forward.
        """


@runtime_checkable
class DeviceModel(EventModel, Protocol):
    """An event model on a GPU, which takes light from there too."""

    on_device: bool
    """True"""


@runtime_checkable
class ChunkedModel(EventModel, Protocol):
    """An event model that can take several ticks at once, with the same events."""

    def step_chunk(
        self, luminance: F32, state: Any, t_begin_us: int, tick_us: int
    ) -> tuple[list[Events], Any]:
        """Turn the light of T ticks of the same length into events, with the same bytes.

        Args:
            luminance: (T, h, w) float32, linear, at the end of each tick.
            state: See `step`. It is consumed.
            t_begin_us: Where the first tick begins, us.
            tick_us: Length of a tick, us.

        Returns:
            The events of each tick, and the state after them.
        """
