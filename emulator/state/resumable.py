"""Resumable: what can be saved, and go on here or elsewhere with the same bytes.

A state is the named arrays of many stages in one flat dictionary: `cameras.0.pixels.reference`, ...
Numbers and words are arrays without dimensions, so that it is arrays and nothing else.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Commit
from evs.emulator.state.blob import Array, Row, pack, unpack
from evs.msgs import EvsError


def check_identity(saved: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    """Check that a state is restored where it was saved.

    Args:
        saved: What it was saved by: plain values, nested. The key "model" is of MuJoCo's model.
        here: What restores it.

    Raises:
        EvsError: Something differs; the message has the first difference, its path and both values.
    """
    for path, ours, theirs in _differences("", saved, here):
        name = path.removeprefix(".")
        if name == "kind":
            raise EvsError(
                f"saved by a {_shown(ours)}, this is a {_shown(theirs)}: restore it where it was "
                "saved"
            )
        if name == "model":
            raise EvsError(
                f"saved by another model ({_shown(ours)}, not {_shown(theirs)}): restore it into "
                "a world of the same scene and tick"
            )
        raise EvsError(
            f"saved by another configuration: {name} was {_shown(ours)}, here it is "
            f"{_shown(theirs)}; restore it where it is the same"
        )


class _Nothing:
    """What one side does not have."""


def _differences(path: str, ours: Any, theirs: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
        for key in [*theirs, *(key for key in ours if key not in theirs)]:
            yield from _differences(
                f"{path}.{key}", ours.get(key, _Nothing), theirs.get(key, _Nothing)
            )
    elif isinstance(ours, list | tuple) and isinstance(theirs, list | tuple):
        if len(ours) != len(theirs):
            yield path, ours, theirs
            return
        for place, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            yield from _differences(f"{path}.{place}", one, other)
    elif ours != theirs or isinstance(ours, bool) != isinstance(theirs, bool):
        yield path, ours, theirs


def _shown(value: Any) -> str:
    text = "nothing" if value is _Nothing else value if isinstance(value, str) else repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:77]}..."


Saved = dict[str, np.ndarray[Any, Any]]
"""name -> array"""

_ROOM_BYTES, _OF_OURS, _OF_BLOB = 64 * 2**20, 16, 32
"""What a blob may take in memory: so many bytes, and so many for each of ours and of its own.

Light and events that wait are all that a state may have more of than there is of it now.
"""
MOST = 2**52
"""of a counter or a time: 142 years in us"""


def joined(**parts: Mapping[str, np.ndarray[Any, Any]]) -> Saved:
    """The arrays of several parts under their names: `part.array`. A name may have dots itself."""
    return {
        f"{name}.{key}": array for name, arrays in parts.items() for key, array in arrays.items()
    }


def part(saved: Mapping[str, np.ndarray[Any, Any]], name: str) -> Saved:
    """The arrays of one part under their own names; none where it is not there."""
    begin = f"{name}."
    return {key[len(begin) :]: array for key, array in saved.items() if key.startswith(begin)}


def unpack_here(blob: bytes, identity: Mapping[str, Any], here: Saved) -> Saved:
    """Unpack the arrays of a state that was saved in an object like this one.

    Args:
        blob: What `pack` gave.
        identity: The description that it has to have.
        here: The arrays as they would be saved now; names, kinds and dimensions have to agree.

    Raises:
        EvsError: They do not; before memory is allocated for them.
    """

    def check(about: Mapping[str, Any], rows: Mapping[str, Row]) -> None:
        check_identity(about, identity)
        check_like(rows, here)
        room = _ROOM_BYTES + _OF_OURS * sum(array.nbytes for array in here.values())
        if sum(row.nbytes for row in rows.values()) > room + _OF_BLOB * len(blob):
            raise EvsError(
                f"saved state is damaged: {len(blob)} bytes hold arrays of "
                f"{sum(row.nbytes for row in rows.values())}; save it again"
            )

    return unpack(blob, check)[1]


def check_like(saved: Mapping[str, Array | Row], here: Saved) -> None:
    """EvsError unless both have the same names, kinds of values and numbers of dimensions."""
    for name in sorted(saved.keys() ^ here.keys()):
        what = "lacks" if name in here else "has an unknown"
        raise EvsError(f"saved state is damaged: it {what} '{name}'; save it again")
    for name, array in here.items():
        other = saved[name]
        kinds = [one.dtype.kind if one.dtype.kind == "U" else one.dtype for one in (array, other)]
        if kinds[0] != kinds[1] or array.ndim != other.ndim:
            raise EvsError(
                f"saved state is damaged: {name} is {other.dtype} of {other.ndim} dimensions; "
                "save it again"
            )


def numbers(**values: int) -> Saved:
    """Whole numbers of 64 bits as arrays."""
    return {name: np.array(value, np.int64) for name, value in values.items()}


def words(**values: str) -> Saved:
    """Texts as arrays."""
    return {name: np.array(value, np.str_) for name, value in values.items()}


def number(
    saved: Mapping[str, np.ndarray[Any, Any]], name: str, low: int = -MOST, high: int = MOST
) -> int:
    """A whole number within low ... high. Raises EvsError."""
    value = saved.get(name)
    if value is None or value.dtype != np.int64 or value.shape or not low <= int(value) <= high:
        raise EvsError(f"saved state is damaged: {name} is invalid; save it again")
    return int(value)


def word(saved: Mapping[str, np.ndarray[Any, Any]], name: str) -> str:
    """A text. Raises EvsError."""
    value = saved.get(name)
    if value is None or value.dtype.kind != "U" or value.shape:
        raise EvsError(f"saved state is damaged: {name} is invalid; save it again")
    return str(value)


def whole(saved: Mapping[str, np.ndarray[Any, Any]], name: str) -> int:
    """A whole number of any size, a seed, that was saved as a word. Raises EvsError."""
    digits = word(saved, name)
    if not re.fullmatch(r"-?[0-9]{1,1000}", digits):
        raise EvsError(f"saved state is damaged: {name} is invalid; save it again")
    return int(digits)


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
            blob: The result of `save`.

        Raises:
            EvsError: It is damaged, or of another model or configuration; nothing has changed.
        """
        self.prepare_restore(unpack_here(blob, self.identity, self.arrays()))()
