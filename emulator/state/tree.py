"""Named arrays of many stages in one flat dictionary: `cameras.0.pixels.reference`, ...

Numbers and words are arrays without dimensions, so that a saved state is arrays and nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.emulator.state.blob import Array, Row, unpack
from evs.emulator.state.identity import check_identity
from evs.msgs import EvsError

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
