"""Families: networks of one design, each trained on light of another number of samples.

The files NAME_1spp.onnx, NAME_4spp.onnx ... are the members of family NAME. Light of few samples
needs a network that averages long, light of many one that does not: a camera takes the member
whose samples come nearest to its own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import TypeVar

T = TypeVar("T")

MEMBER = re.compile(r"(?P<family>.+)_(?P<spp>[1-9][0-9]{0,5})spp")


def members(family: str, names: Iterable[str]) -> dict[int, str]:
    """Samples a pixel -> name, of the networks that belong to a family, in order."""
    found = {}
    for name in names:
        parts = MEMBER.fullmatch(name)
        if parts is not None and parts["family"] == family:
            found[int(parts["spp"])] = name
    return dict(sorted(found.items()))


def families(names: Iterable[str]) -> list[str]:
    """Names of the families that these networks belong to, in alphabetical order."""
    return sorted({parts["family"] for name in names if (parts := MEMBER.fullmatch(name))})


def nearest_member(found: Mapping[int, T], spp: int) -> T:
    """The member for light of so many samples a pixel; 0: light without noise.

    The nearest by ratio; of two that are as near, the one of fewer samples.
    """
    if spp == 0:
        return found[max(found)]
    return found[min(found, key=lambda own: (abs(math.log2(own / spp)), own))]
