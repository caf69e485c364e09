"""Resets and restores of worlds, all or none of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any, NamedTuple, Protocol

from evs.emulator.base.protocols import Commit
from evs.emulator.state import Saved, unpack_here
from evs.emulator.world import MjData, Physics
from evs.msgs import EvsError


class PreparedReset(NamedTuple):
    """A reset of a world that can be done."""

    keyframe: int
    """id of the keyframe to start from; -1: qpos0"""
    values: dict[str, float] | None
    """of the scene; None: those that hold"""
    commit: Commit
    """forgets all that the world has seen, with another seed and sensor if so wanted"""


class ResettableWorld(Protocol):
    """What resets and restores need of a World."""

    @property
    def physics(self) -> Physics:
        """See `World`."""

    @property
    def data(self) -> MjData:
        """See `World`."""

    @property
    def identity(self) -> dict[str, Any]:
        """See `World`."""

    def start_physics(self, keyframe: int) -> None:
        """See `World`."""

    def values_of(self, blob: bytes) -> AbstractContextManager[None]:
        """See `World`."""

    def with_values(self, values: Mapping[str, float] | None) -> AbstractContextManager[None]:
        """See `World`."""

    def arrays(self) -> Saved:
        """See `World`."""

    def prepare_restore(self, saved: Saved) -> Commit:
        """See `World`."""

    def see_closely(self) -> bool:
        """See `World`."""


def over_at_once(reason: str) -> EvsError:
    """The error of a start outside the limits."""
    return EvsError(
        f"the episode is over where it begins ({reason}): narrow start, or widen limits"
    )


@contextmanager
def reset_worlds(
    worlds: Sequence[ResettableWorld],
    resets: Sequence[PreparedReset],
    starts: Sequence[Callable[[MjData], None] | None] | None = None,
) -> Iterator[None]:
    """Reset worlds, all or none of them: if the block raises, nothing has changed.

    In the block, each has its values, and its physics is where the episode begins. Cameras are
    reset at the end.

    Args:
        worlds: The worlds.
        resets: What World.prepare_reset gave for each.
        starts: For each, what puts its data into another state; None: nothing.

    Raises:
        EvsError: Values make no model, or a start raises it.
    """
    starts = [None] * len(worlds) if starts is None else starts
    with ExitStack() as undo:
        for world in worlds:
            undo.enter_context(world.physics.unchanged_on_error())
        for world, reset in zip(worlds, resets, strict=True):
            undo.enter_context(world.with_values(reset.values))
        for world, reset, start in zip(worlds, resets, starts, strict=True):
            world.start_physics(reset.keyframe)
            if start is not None:
                start(world.data)
        yield
    for reset in resets:
        reset.commit()


def restore_worlds(worlds: Sequence[ResettableWorld], blobs: Sequence[bytes]) -> None:
    """Restore worlds, all or none of them.

    Args:
        worlds: The worlds.
        blobs: What World.save gave, for each.

    Raises:
        EvsError: See `World.restore`. Nothing has changed.
    """
    with ExitStack() as undo:
        for world, blob in zip(worlds, blobs, strict=True):
            undo.enter_context(world.values_of(blob))
        saved = [
            unpack_here(blob, world.identity, world.arrays())
            for world, blob in zip(worlds, blobs, strict=True)
        ]
        prepare_restore_worlds(worlds, saved)()


def prepare_restore_worlds(worlds: Sequence[ResettableWorld], saved: Sequence[Saved]) -> Commit:
    """Check saved states; the commit puts all of them in place.

    Args:
        worlds: The worlds, within `values_of` of their states.
        saved: One state for each world; see `World.prepare_restore`.

    Raises:
        EvsError: One is damaged; nothing has changed.
    """
    commits = [world.prepare_restore(one) for world, one in zip(worlds, saved, strict=True)]
    seen = [world.see_closely() for world in worlds]
    if any(seen):
        # the cameras have other renderers
        commits = [world.prepare_restore(one) for world, one in zip(worlds, saved, strict=True)]

    def commit() -> None:
        for one in commits:
            one()

    return commit
