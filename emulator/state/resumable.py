"""Resumable: what can be saved, and go on here or elsewhere with the same bytes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from evs.emulator.base.protocols import Commit
from evs.emulator.state.blob import pack
from evs.emulator.state.tree import Saved, unpack_here


class Resumable(ABC):
    """Has a state that everything later follows from."""

    @property
    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """Where a saved state belongs, in plain values: what shapes the events, seed aside."""

    @abstractmethod
    def arrays(self) -> Saved:
        """What `save` packs, by name."""

    @abstractmethod
    def prepare_restore(self, saved: Saved) -> Commit:
        """Check a saved state; the commit puts it in place.

        Args:
            saved: What `arrays` gave; names, kinds and dimensions are checked already.

        Raises:
            EvsError: It is damaged.
        """

    def save(self, compress: bool = False) -> bytes:
        """Save everything that comes next follows from, but for what is given to it from outside.

        Outside are the data that an EventCamera observes, the frames of Pixels, and a control
        function of the caller's own.

        Args:
            compress: Half the size, in about 6 times the time.

        Returns:
            What `restore` takes.

        Raises:
            EvsError: A ClosedLoop was not reset before.
        """
        return pack(self.identity, self.arrays(), compress)

    def restore(self, blob: bytes) -> Any:
        """Go on from where `save` was called, in this process or another, with the same bytes.

        Seed, threads and instruction set may be others: the seed is restored.

        Args:
            blob: What `save` gave.

        Raises:
            EvsError: It is damaged, or of another model or configuration; nothing has changed.
        """
        self.prepare_restore(unpack_here(blob, self.identity, self.arrays()))()
